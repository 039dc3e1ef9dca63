"""The fit of a variation: the residuals' scale, their principal directions, and the covariance of their waves.

The logarithm of a gap's root mean square residual is regressed on the features of the gap, for gaps between two keys
and for gaps with one. Residuals are divided by that scale. Their principal directions over all tokens become E, and
least squares gives each gap's coefficients of the waves, whose covariance over gaps is F F^T. All archives have the
same weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.shared.inference.variation import FEATURES, WAVES, GapPath, Variation

DIRECTIONS, RANK = 24, 48
_RIDGE = 1e-3


@dataclass(frozen=True)
class Residual:
    """What a gap's true motion has beyond its fill: latents (n, D) and centroids (n, 3), metres, at the gap's tokens,
    seen from where the body faces +Z. archive: the name of the recordings that it is from."""

    archive: str
    gap: GapPath
    latents: np.ndarray
    centroids: np.ndarray


def fit_variation(residuals: Sequence[Residual], digest: str) -> Variation:
    """The distribution of residuals of an encoder's latents. Gaps shorter than two tokens for each wave tell the
    scale alone.

    Raises: ValueError where no gap is long enough.
    """
    weights = _archive_weights(residuals)
    scale = np.stack([_scale(residuals, weights, open_) for open_ in (False, True)])
    sizes = [np.exp(scale[int(each.gap.open)] @ each.gap.features()) for each in residuals]
    latents = np.concatenate([each.latents / size for each, size in zip(residuals, sizes, strict=True)])
    each_token = np.concatenate(
        [np.full(len(r.latents), w / len(r.latents)) for r, w in zip(residuals, weights, strict=True)]
    )
    directions = _principal(latents, each_token, DIRECTIONS)
    found, of_found = [], []
    for each, size, weight in zip(residuals, sizes, weights, strict=True):
        if len(each.latents) >= 2 * WAVES:
            values = np.concatenate([each.latents @ directions.T, each.centroids], -1) / size
            found.append(_coefficients(each.gap.waves(), values))
            of_found.append(weight)
    if not found:
        raise ValueError("no gap is long enough")
    rows = np.stack(found).reshape(len(found), -1)
    return Variation(directions, _factor(rows, np.array(of_found)), scale, digest)


def _archive_weights(residuals: Sequence[Residual]) -> np.ndarray:
    """(N,) weights of gaps, of sum 1 and equal sums for all archives."""
    names = [each.archive for each in residuals]
    counts = {name: names.count(name) for name in set(names)}
    return np.array([1 / (counts[name] * len(counts)) for name in names])


def _scale(residuals: Sequence[Residual], weights: np.ndarray, open_: bool) -> np.ndarray:
    """Weights of log s by least squares; those of all gaps where no gap is of this kind."""
    own = [n for n, each in enumerate(residuals) if each.gap.open == open_] or list(range(len(residuals)))
    features = np.stack([residuals[n].gap.features() for n in own])
    powers = np.array([np.square(residuals[n].latents).mean() for n in own])
    wanted = 0.5 * np.log(np.maximum(powers, 1e-12))
    root = np.sqrt(weights[own])[:, None]
    ridge = _RIDGE * np.eye(FEATURES) * root.sum() / len(own)
    found, *_ = np.linalg.lstsq(
        np.vstack([features * root, ridge]), np.concatenate([wanted * root[:, 0], np.zeros(FEATURES)]), rcond=None
    )
    # The mean power of residuals, not the mean of its logarithm.
    left = np.exp(2 * (wanted - features @ found))
    found[0] += 0.5 * np.log(np.average(left, weights=weights[own]))
    return found


def _principal(values: np.ndarray, weights: np.ndarray, count: int) -> np.ndarray:
    """(count, D) eigenvectors of the second moments of rows (N, D), the largest first."""
    moments = (values * weights[:, None]).T @ values
    _, vectors = np.linalg.eigh(moments)
    return vectors[:, ::-1][:, :count].T


def _coefficients(waves: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(WAVES, R + 3) least squares of values (n, R + 3)."""
    return np.linalg.lstsq(waves, values, rcond=None)[0]


def _factor(rows: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(WAVES, R + 3, M) F of low rank, with F F^T near the second moments of rows (N, WAVES * (R + 3)); what the rank
    leaves out of each coefficient's power is given back to it."""
    shares = weights / weights.sum()
    moments = (rows * shares[:, None]).T @ rows
    powers = np.sqrt(np.maximum(np.diag(moments), 1e-12))
    values, vectors = np.linalg.eigh(moments / np.outer(powers, powers))
    kept = slice(-min(RANK, len(rows)), None)
    factor = vectors[:, kept] * np.sqrt(np.maximum(values[kept], 0))
    factor *= (powers / np.maximum(np.linalg.norm(factor, axis=1), 1e-6))[:, None]
    return factor.reshape(WAVES, -1, factor.shape[1])
