"""The constraints that are measured: what is asked of a window, and which joints are compared."""

from __future__ import annotations

import numpy as np

from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.shared.inference.constraints.asked import Constraints, PartFrames, Pin, RootPath
from stages.shared.inference.constraints.rig_parts import end_effector
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.rotations import rotate
from stages.shared.statistics.measurements import measured_joints

_HANDS = ("left_hand", "right_hand")
_COMPARED = {
    "arms": ("left_arm", "right_arm"),
    "legs": ("left_leg", "right_leg"),
    "hands": ("left_arm", "right_arm"),
    "path": BODY_GROUPS,
}


def asked_of(constraint: str, skeleton: Skeleton, truth: Motion, interval: int) -> Constraints:
    """What is asked of a window of T true frames with a key every `interval` frames."""
    keys = f"every:{interval}"
    if constraint in ("arms", "legs"):
        return Constraints(parts=(PartFrames(part=constraint, frames=keys),))
    if constraint == "path":
        pelvis = positions_of(skeleton, truth)[:, skeleton.root]
        places = tuple((float(x), float(z)) for x, _, z in pelvis)
        return Constraints(keyframes=keys, path=RootPath(frames=tuple(range(truth.frames)), places=places))
    pins = []
    heads = positions_of(skeleton, truth)
    for hand in _HANDS:
        end = end_effector(skeleton, hand, hand)
        places = heads[:, end.joint] + rotate(truth.rotations[:, end.joint].astype(np.float64), end.tail)
        pins.append(Pin(end=hand, frames="all", places=tuple((float(x), float(y), float(z)) for x, y, z in places)))
    return Constraints(keyframes=keys, pins=tuple(pins))


def compared_joints(constraint: str, skeleton: Skeleton) -> np.ndarray:
    """Indices of the joints whose errors are compared."""
    groups = [BODY_GROUPS.index(group) for group in _COMPARED[constraint]]
    joints = measured_joints(skeleton)
    return joints[np.isin(skeleton.groups[joints], groups)]
