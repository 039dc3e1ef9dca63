"""Changed rigs lie on the floor of kinematics, where the measuring stages share them."""

from stages.shared.humanoid.rig_changes import (
    RIGS,
    Rigged,
    with_extra_spine,
    with_fingers,
    with_other_axes,
    with_other_proportions,
    with_twist_joints,
)

__all__ = [
    "RIGS",
    "Rigged",
    "with_extra_spine",
    "with_fingers",
    "with_other_axes",
    "with_other_proportions",
    "with_twist_joints",
]
