"""Questions about the tree of joints. In NumPy alone, so that what reads files starts without loading torch."""

from __future__ import annotations

import numpy as np


def pelvis_and_above(parents: np.ndarray, pelvis: int) -> np.ndarray:
    """(J,) bool: the joints that turn the whole body, of a tree with parents (J,)."""
    found = np.zeros(len(parents), bool)
    joint = pelvis
    while joint >= 0:
        found[joint] = True
        joint = int(parents[joint])
    return found
