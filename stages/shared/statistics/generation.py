"""Measures of generated motions by features of an action recogniser (motion concepts B.2): FID, A-FID, accuracy,
diversity, multimodality.

Samples are drawn as the paper draws them, with replacement where there are fewer. The paper repeats every measure 20
times and gives the 95 % interval of the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

REPETITIONS = 20
FID_SAMPLES, ACTION_SAMPLES = 3000, 200
DIVERSITY_PAIRS, MULTIMODALITY_PAIRS = 200, 20
_NORMAL_95 = 1.959964


@dataclass(frozen=True)
class Repeated:
    """The mean of repeated measurements, and half the width of its 95 % interval."""

    value: float
    half_width: float


def frechet_distance(one: np.ndarray, other: np.ndarray) -> float:
    """|m1 - m2|^2 + trace(C1 + C2 - 2 (C1 C2)^(1/2)) of features (N, D) and (M, D), N and M at least 2.

    The trace of the root is the sum of the roots of the eigenvalues of C1^(1/2) C2 C1^(1/2), which is symmetric.
    """
    means = [features.mean(axis=0) for features in (one, other)]
    first, second = (np.atleast_2d(np.cov(features, rowvar=False)) for features in (one, other))
    values, vectors = np.linalg.eigh(first)
    root = (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T
    shared = np.sqrt(np.maximum(np.linalg.eigvalsh(root @ second @ root), 0)).sum()
    return float(np.square(means[0] - means[1]).sum() + np.trace(first) + np.trace(second) - 2 * shared)


def fid(generated: np.ndarray, real: np.ndarray, rng: np.random.Generator) -> float:
    """The Frechet distance of `FID_SAMPLES` generated and real motions' features (N, D), over all actions."""
    return frechet_distance(*(features[_drawn(len(features), FID_SAMPLES, rng)] for features in (generated, real)))


def action_fid(
    generated: np.ndarray, made: np.ndarray, real: np.ndarray, labels: np.ndarray, rng: np.random.Generator
) -> float:
    """A-FID: the mean over actions of the Frechet distance of `ACTION_SAMPLES` motions of each.

    Args:
        generated (N, D) with their actions `made` (N,); real (M, D) with `labels` (M,). Actions without two real and
            two generated motions are left out.
    """
    found = []
    for action in np.unique(labels):
        both = generated[made == action], real[labels == action]
        if min(map(len, both)) >= 2:
            found.append(frechet_distance(*(each[_drawn(len(each), ACTION_SAMPLES, rng)] for each in both)))
    return float(np.mean(found)) if found else float("nan")


def accuracy(logits: np.ndarray, made: np.ndarray) -> float:
    """The share of motions whose largest logit (N, C) is that of their action (N,)."""
    return float((logits.argmax(axis=1) == made).mean())


def diversity(features: np.ndarray, rng: np.random.Generator) -> float:
    """Equation 6: the mean distance of `DIVERSITY_PAIRS` pairs of motions of all actions; features (N, D)."""
    first, second = (features[_drawn(len(features), DIVERSITY_PAIRS, rng)] for _ in range(2))
    return float(np.linalg.norm(first - second, axis=1).mean())


def multimodality(features: np.ndarray, made: np.ndarray, rng: np.random.Generator) -> float:
    """Equation 7: the mean distance of `MULTIMODALITY_PAIRS` pairs of motions of one action, over all actions."""
    found = []
    for action in np.unique(made):
        mine = features[made == action]
        first, second = (mine[_drawn(len(mine), MULTIMODALITY_PAIRS, rng)] for _ in range(2))
        found.append(np.linalg.norm(first - second, axis=1).mean())
    return float(np.mean(found))


def measures_of(
    features: np.ndarray, logits: np.ndarray, made: np.ndarray, real: tuple[np.ndarray, np.ndarray] | None
) -> dict[str, Callable[[np.random.Generator], float]]:
    """All measures of motions, by name, each a function of a generator.

    Args:
        features (N, D) and logits (N, C) of the motions, with their actions `made` (N,).
        real: features (M, D) and actions (M,) of the real motions; None leaves FID and A-FID out.
    """
    found: dict[str, Callable[[np.random.Generator], float]] = {}
    if real is not None:
        found["a_fid"] = lambda rng: action_fid(features, made, real[0], real[1], rng)
        found["fid"] = lambda rng: fid(features, real[0], rng)
    found["accuracy"] = lambda rng: _drawn_accuracy(logits, made, rng)
    found["diversity"] = lambda rng: diversity(features, rng)
    found["multimodality"] = lambda rng: multimodality(features, made, rng)
    return found


def _drawn_accuracy(logits: np.ndarray, made: np.ndarray, rng: np.random.Generator) -> float:
    """The accuracy of `FID_SAMPLES` motions."""
    chosen = _drawn(len(made), FID_SAMPLES, rng)
    return accuracy(logits[chosen], made[chosen])


def repeated(
    measures: Mapping[str, Callable[[np.random.Generator], float]], seed: int, times: int = REPETITIONS
) -> dict[str, Repeated]:
    """Each measure `times` times, with a generator of its own every time."""
    out = {}
    for place, (name, measure) in enumerate(measures.items()):
        values = np.array([measure(np.random.default_rng((seed, place, turn))) for turn in range(times)])
        spread = values.std(ddof=1) / np.sqrt(times) if times > 1 else 0.0
        out[name] = Repeated(float(values.mean()), float(_NORMAL_95 * spread))
    return out


def _drawn(count: int, wanted: int, rng: np.random.Generator) -> np.ndarray:
    """`wanted` indices below `count`: without repetition where there are enough."""
    return rng.choice(count, wanted, replace=count < wanted)
