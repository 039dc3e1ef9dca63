"""Runs of frames for which something is true, and stretches that begin and end at keys."""

from __future__ import annotations

import numpy as np


def runs_of(flags: np.ndarray) -> list[np.ndarray]:
    """Runs of True in (T,) bool, as arrays of indices."""
    found = np.flatnonzero(flags)
    return [run for run in np.split(found, np.flatnonzero(np.diff(found) > 1) + 1) if len(run)]


def widened_to_keys(keys: np.ndarray, start: int, stop: int) -> tuple[int, int]:
    """Frames `start` to `stop` (excluded) extended to the nearest keys at or beyond both ends, where there are such,
    so that every gap among them has its keys.

    Args:
        keys: (K,) rising.
    """
    before = int(np.searchsorted(keys, start, side="right")) - 1
    after = int(np.searchsorted(keys, stop - 1))
    return int(keys[before]) if before >= 0 else start, int(keys[after]) + 1 if after < len(keys) else stop
