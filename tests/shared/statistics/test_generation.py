"""Measures of generated motions against plain formulas and SciPy's matrix root."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import sqrtm

from stages.shared.statistics import generation


def plain_frechet(one: np.ndarray, other: np.ndarray) -> float:
    """The formula with a general matrix root."""
    first, second = np.cov(one.T), np.cov(other.T)
    root = np.real(np.asarray(sqrtm(first @ second)))
    return float(((one.mean(0) - other.mean(0)) ** 2).sum() + np.trace(first + second - 2 * root))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), width=st.integers(2, 6), shift=st.floats(-3, 3))
def test_the_frechet_distance_is_the_formula(seed: int, width: int, shift: float):
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=(60, width)), rng.normal(size=(50, width)) * 1.5 + shift
    assert generation.frechet_distance(one, other) == pytest.approx(plain_frechet(one, other), rel=1e-4, abs=1e-5)
    assert generation.frechet_distance(one, other) == pytest.approx(generation.frechet_distance(other, one), abs=1e-8)
    assert generation.frechet_distance(one, one) == pytest.approx(0, abs=1e-8)


def test_distances_of_known_distributions():
    rng = np.random.default_rng(0)
    real = rng.normal(size=(4000, 3))
    moved = rng.normal(size=(4000, 3)) + np.array([2.0, 0, 0])
    assert generation.fid(moved, real, rng) == pytest.approx(4, rel=0.1)
    wide = 3 * rng.normal(size=(4000, 1))
    assert generation.frechet_distance(wide, real[:, :1]) == pytest.approx(4, rel=0.1)  # (3 - 1)^2


def test_an_actions_distance_sees_what_the_whole_sets_does_not():
    """Two actions that are swapped: the whole sets are alike, the actions are not."""
    rng = np.random.default_rng(1)
    real = np.concatenate([rng.normal(size=(300, 2)), rng.normal(size=(300, 2)) + 5])
    labels = np.repeat([0, 1], 300)
    assert generation.fid(real, real, rng) < 0.1
    assert generation.action_fid(real, labels, real, labels, rng) < 0.5
    assert generation.action_fid(real, 1 - labels, real, labels, rng) > 20


def test_accuracy_diversity_and_multimodality_are_means():
    logits = np.array([[2.0, 1.0], [0.0, 1.0], [3.0, 0.0]])
    assert generation.accuracy(logits, np.array([0, 1, 1])) == pytest.approx(2 / 3)
    rng = np.random.default_rng(2)
    points = np.repeat([[0.0, 0.0], [3.0, 4.0]], 500, axis=0)
    made = np.repeat([0, 1], 500)
    assert generation.multimodality(points, made, rng) == 0
    assert np.mean([generation.diversity(points, rng) for _ in range(20)]) == pytest.approx(2.5, abs=0.2)
    spread = rng.normal(size=(1000, 2))
    plain = np.mean([np.linalg.norm(a - b) for a, b in zip(spread[:500], spread[500:], strict=True)])
    assert np.mean([generation.diversity(spread, rng) for _ in range(20)]) == pytest.approx(plain, rel=0.1)


def plain_measures(features, logits, made, real, labels) -> dict[str, float]:
    """Every measure by its formula, over all motions: what the drawn ones estimate."""

    def pairs(rows: np.ndarray) -> float:
        return float(np.mean([np.linalg.norm(rows - each, axis=1).mean() for each in rows]))

    actions = sorted(set(labels.tolist()))
    return {
        "fid": plain_frechet(features, real),
        "a_fid": float(np.mean([plain_frechet(features[made == a], real[labels == a]) for a in actions])),
        "accuracy": sum(int(np.argmax(row)) == kind for row, kind in zip(logits, made, strict=True)) / len(made),
        "diversity": pairs(features),
        "multimodality": float(np.mean([pairs(features[made == a]) for a in actions])),
    }


def test_drawn_measures_estimate_those_of_all_motions():
    rng = np.random.default_rng(5)
    made, labels = np.repeat([0, 1, 2], 220), np.repeat([0, 1, 2], 240)
    features = rng.normal(size=(660, 3)) * 1.3 + made[:, None]
    real = rng.normal(size=(720, 3)) + labels[:, None]
    logits = rng.normal(size=(660, 3)) + 2 * np.eye(3)[made]
    plain = plain_measures(features, logits, made, real, labels)
    found = generation.repeated(generation.measures_of(features, logits, made, (real, labels)), 0, 10)
    assert set(found) == set(plain)
    for name, value in plain.items():
        assert found[name].value == pytest.approx(value, rel=0.1), name
    assert set(generation.measures_of(features, logits, made, None)) == {"accuracy", "diversity", "multimodality"}


def test_repetitions_give_the_interval_of_the_mean_and_are_the_same_again():
    found = generation.repeated({"a": lambda rng: float(rng.normal()), "b": lambda rng: 2.0}, seed=3, times=400)
    assert found["a"].half_width == pytest.approx(1.96 / 20, rel=0.1) and abs(found["a"].value) < 0.2
    assert found["b"] == generation.Repeated(2.0, 0.0)
    assert found == generation.repeated({"a": lambda rng: float(rng.normal()), "b": lambda rng: 2.0}, 3, 400)


def test_few_motions_are_drawn_with_repetition():
    rng = np.random.default_rng(4)
    few = rng.normal(size=(5, 2))
    assert np.isfinite(generation.fid(few, few, rng)) and generation.diversity(few, rng) > 0
    assert np.isnan(generation.action_fid(few, np.zeros(5), few, np.ones(5), rng))
