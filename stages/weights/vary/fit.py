"""The fit of a variation: the residuals' scale, their principal directions, and the strongest modes of their waves.

The logarithm of a gap's root mean square residual is regressed on the features of the gap, for gaps between two keys
and for gaps with one. Residuals are divided by that scale. Their principal directions over all tokens become E, and
least squares gives each gap's coefficients of the waves. F has the strongest modes of these coefficients' covariance
over gaps, in which all centroids together count as a share of the power of all latents. Archives weigh the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.shared.inference.variation import CENTROID, FEATURES, WAVES, GapPath, Variation

DIRECTIONS, MODES = 16, 8
CENTROID_SHARE = 0.25
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
    """The distribution of residuals of an encoder's latents. Gaps shorter than two tokens for each wave are used for
    the scale alone.

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
    centroids = np.concatenate([each.centroids / size for each, size in zip(residuals, sizes, strict=True)])
    powers = [float(np.square(values).sum(1) @ each_token) for values in (latents, centroids)]
    units = np.ones(DIRECTIONS + CENTROID)  # of the coefficients in the covariance
    units[-CENTROID:] = np.sqrt(CENTROID_SHARE * powers[0] / max(powers[1], 1e-12))
    found, of_found = [], []
    for each, size, weight in zip(residuals, sizes, weights, strict=True):
        if len(each.latents) >= 2 * WAVES:
            values = np.concatenate([each.latents @ directions.T, each.centroids], -1) / size
            found.append(_coefficients(each.gap.waves(), values) * units)
            of_found.append(weight)
    if not found:
        raise ValueError("no gap is long enough")
    factor = _factor(np.stack(found), np.array(of_found)) / units[:, None]
    return Variation(directions, factor, scale, digest)


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


def _factor(coefficients: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(WAVES, R + 3, MODES) the strongest modes of coefficients (N, WAVES, R + 3), each as long as its deviation."""
    rows = coefficients.reshape(len(coefficients), -1)
    moments = (rows * (weights / weights.sum())[:, None]).T @ rows
    values, vectors = np.linalg.eigh(moments)
    factor = vectors[:, -MODES:] * np.sqrt(np.maximum(values[-MODES:], 0))
    return factor.reshape(WAVES, coefficients.shape[2], -1)
