"""Percentiles and medians to NumPy's bits, for short arrays in a fraction of the time of NumPy's own calls."""

from __future__ import annotations

import math

import numpy as np


def percentile(values: np.ndarray, percent: float) -> np.ndarray:
    """What `np.percentile(values, percent, axis=0)` returns, for values (N, ...) and 0 to 100 percent."""
    last = len(values) - 1
    if values.dtype != np.float64 or last < 0:
        return np.percentile(values, percent, axis=0)
    place = last * (percent / 100)
    below = math.floor(place)
    above = min(below + 1, last)
    found = np.partition(values, (below, above, last), axis=0)
    low, high, share = found[below], found[above], place - below
    if np.isnan(found[last]).any():  # NaN is sorted to the end
        return np.percentile(values, percent, axis=0)
    # As NumPy does it: from the nearer of the two, so that the result is never beyond either.
    return low + (high - low) * share if share < 0.5 else high - (high - low) * (1 - share)


def median(values: np.ndarray) -> np.ndarray:
    """What `np.median(values, axis=0)` returns, for values (N, ...)."""
    last, middle = len(values) - 1, len(values) // 2
    if values.dtype != np.float64 or last < 0:
        return np.median(values, axis=0)
    before = middle if len(values) % 2 else middle - 1
    found = np.partition(values, (before, middle, last), axis=0)
    if np.isnan(found[last]).any():
        return np.median(values, axis=0)
    return found[middle] if before == middle else (found[before] + found[middle]) / 2
