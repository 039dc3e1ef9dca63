"""Left and right limbs that are exchanged for a stretch of frames: how that looks, how it is found, and undone.

The joints of the two limbs exchange their rotations in their parents' frames. Where the limbs begin at one joint, or
at joints that are exchanged too, their rotations in the world are exchanged by that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def exchanged(local: np.ndarray, at: np.ndarray, limb: np.ndarray) -> np.ndarray:
    """Rotations (T, J, 4) with the joints of a limb exchanged with those of the other side in some frames.

    Args:
        at: (T,) bool or indices of frames. limb: (P, 2) pairs of left and right joints.
    """
    out = local.copy()
    left, right = limb.T
    rows = np.flatnonzero(at) if at.dtype == bool else at
    out[rows[:, None], left], out[rows[:, None], right] = local[rows[:, None], right], local[rows[:, None], left]
    return out


def joints_of(limbs: Sequence[np.ndarray]) -> np.ndarray:
    """The joints of both sides of limbs, in rising order."""
    return np.unique(np.concatenate([limb.ravel() for limb in limbs])) if limbs else np.zeros(0, np.int64)
