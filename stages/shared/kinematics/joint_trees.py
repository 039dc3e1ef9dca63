"""Which joints of a skeleton hang on which."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def and_below(parents: np.ndarray, joints: Iterable[int], but: Iterable[int] = ()) -> list[int]:
    """Joints and all joints below them, parents first, without those of `but` and the joints below those.

    Args:
        parents: (J,) index of each joint's parent, smaller than its own; -1 at the top.
    """
    found, left_out = set(joints), set(but)
    for joint, parent in enumerate(parents):
        if int(parent) in found and joint not in left_out:
            found.add(joint)
    return sorted(found)
