"""Intervals by resampling clips. Windows are not resampled, since the windows of one clip resemble each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

RESAMPLES = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Estimate:
    """A mean with its bootstrap interval; `low` and `high` are None if only one clip was measured."""

    value: float
    low: float | None
    high: float | None


def mean_interval(values: np.ndarray, weights: np.ndarray, seed: int = 0) -> Estimate:
    """The weighted mean over clips, and the interval that holds 95% of the means of resampled sets of clips.

    Args:
        values: (C,) a figure of each clip.
        weights: (C,) its windows, or its power for NPSS.
        seed: of the resampling.
    """
    return ratio_interval(values, weights, np.ones_like(values), weights, seed)


def ratio_interval(
    values: np.ndarray, weights: np.ndarray, base_values: np.ndarray, base_weights: np.ndarray, seed: int = 0
) -> Estimate:
    """The ratio of two weighted means over the same clips, both means taken from the same resampled clips.

    Args: (C,) each, clips in the same order; see `mean_interval`.
    """
    count = len(values)
    top, bottom = values * weights, base_values * base_weights
    value = float(_ratio(top.sum(), weights.sum(), bottom.sum(), base_weights.sum()))
    if count < 2:
        return Estimate(value, None, None)
    drawn = _draws(count, seed)
    ratios = _ratio(drawn @ top, drawn @ weights, drawn @ bottom, drawn @ base_weights)
    low, high = np.quantile(ratios, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Estimate(value, float(low), float(high))


@lru_cache(maxsize=16)
def _draws(count: int, seed: int) -> np.ndarray:
    """(RESAMPLES, count) how often each clip is in each resampled set; cached, since tables need few different
    counts."""
    drawn = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    return drawn.astype(np.float64)


def _ratio(top, top_weight, bottom, bottom_weight) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((top / top_weight) / (bottom / bottom_weight))
