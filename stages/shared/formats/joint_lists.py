"""Common joint lists of position data, in the order of the data, each joint with its direction at rest.

Directions are those of a T-pose, Y up, X to the left, facing Z. Their lengths are not used: bones are measured.
"""

from __future__ import annotations

from functools import partial

from stages.shared.formats.smpl import LAYOUTS, neutral_joints, parents_of

Place = tuple[float, float, float]
JointList = tuple[tuple[str, str, Place], ...]  # name, parent, direction from the parent

_UP, _DOWN, _FORWARD = (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)
_LEFT, _RIGHT = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)

_H36M17: JointList = (
    ("hip", "", _UP), ("right_hip", "hip", _RIGHT), ("right_knee", "right_hip", _DOWN),
    ("right_foot", "right_knee", _DOWN), ("left_hip", "hip", _LEFT), ("left_knee", "left_hip", _DOWN),
    ("left_foot", "left_knee", _DOWN), ("spine", "hip", _UP), ("thorax", "spine", _UP), ("neck", "thorax", _UP),
    ("head", "neck", _UP), ("left_shoulder", "thorax", _LEFT), ("left_elbow", "left_shoulder", _LEFT),
    ("left_wrist", "left_elbow", _LEFT), ("right_shoulder", "thorax", _RIGHT),
    ("right_elbow", "right_shoulder", _RIGHT), ("right_wrist", "right_elbow", _RIGHT),
)  # fmt: skip
_KINECT25: JointList = (
    ("spine_base", "", _UP), ("spine_mid", "spine_base", _UP), ("neck", "spine_shoulder", _UP), ("head", "neck", _UP),
    ("left_shoulder", "spine_shoulder", _LEFT), ("left_elbow", "left_shoulder", _LEFT),
    ("left_wrist", "left_elbow", _LEFT), ("left_hand", "left_wrist", _LEFT),
    ("right_shoulder", "spine_shoulder", _RIGHT), ("right_elbow", "right_shoulder", _RIGHT),
    ("right_wrist", "right_elbow", _RIGHT), ("right_hand", "right_wrist", _RIGHT),
    ("left_hip", "spine_base", _LEFT), ("left_knee", "left_hip", _DOWN), ("left_ankle", "left_knee", _DOWN),
    ("left_foot", "left_ankle", _FORWARD), ("right_hip", "spine_base", _RIGHT), ("right_knee", "right_hip", _DOWN),
    ("right_ankle", "right_knee", _DOWN), ("right_foot", "right_ankle", _FORWARD),
    ("spine_shoulder", "spine_mid", _UP), ("left_finger_tip", "left_hand", _LEFT),
    ("left_thumb", "left_hand", _FORWARD), ("right_finger_tip", "right_hand", _RIGHT),
    ("right_thumb", "right_hand", _FORWARD),
)  # fmt: skip


def _of_smpl(layout: str) -> JointList:
    names, parents, offsets = LAYOUTS[layout], parents_of(layout), neutral_joints(layout).offsets
    return tuple(
        (name, names[parent] if parent >= 0 else "", offset)
        for name, parent, offset in zip(names, parents, offsets, strict=True)
    )


# The names that --skeleton accepts: SMPL with 22 (HumanML3D) or 24 joints, Human3.6M's 17, Kinect's 25.
LISTS = {
    "smpl22": partial(_of_smpl, "body"), "smpl24": partial(_of_smpl, "smpl"), "smplh52": partial(_of_smpl, "smplh"),
    "h36m17": lambda: _H36M17, "kinect25": lambda: _KINECT25,
}  # fmt: skip
