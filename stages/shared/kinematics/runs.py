"""Runs of frames for which something is true."""

from __future__ import annotations

import numpy as np


def runs_of(flags: np.ndarray) -> list[np.ndarray]:
    """Runs of True in (T,) bool, as arrays of indices."""
    found = np.flatnonzero(flags)
    return [run for run in np.split(found, np.flatnonzero(np.diff(found) > 1) + 1) if len(run)]
