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

# Landmarks on a face, with their directions from the middle of the head.
_EARS: JointList = (("left_ear", "head", _LEFT), ("right_ear", "head", _RIGHT))
_NOSE: JointList = (("nose", "head", (0.0, 0.0, 1.0)),)
_EYES: JointList = (("left_eye", "head", (0.35, 0.35, 0.87)), ("right_eye", "head", (-0.35, 0.35, 0.87)))
_LEFT_ARM: JointList = (
    ("left_shoulder", "neck", _LEFT), ("left_elbow", "left_shoulder", _LEFT), ("left_wrist", "left_elbow", _LEFT),
)  # fmt: skip
_LEFT_LEG: JointList = (
    ("left_hip", "hip", _LEFT),
    ("left_knee", "left_hip", _DOWN),
    ("left_ankle", "left_knee", _DOWN),
)
_TRUNK: JointList = (("hip", "", _UP), ("neck", "hip", _UP), ("head", "neck", _UP))
_TRUNK_MIDPOINTS = {
    "hip": ("left_hip", "right_hip"), "neck": ("left_shoulder", "right_shoulder"), "head": ("left_ear", "right_ear"),
}  # fmt: skip


def _mirrored(joints: JointList) -> JointList:
    """The joints of the left as those of the right."""
    return tuple(
        (name.replace("left", "right"), parent.replace("left", "right"), (-x, y, z))
        for name, parent, (x, y, z) in joints
    )


def _in_order(names: str, joints: JointList) -> JointList:
    """The joints in the order of `names`, then those that are not among them."""
    order = names.split()
    by_name = {joint[0]: joint for joint in joints}
    return (*(by_name[name] for name in order), *(joint for joint in joints if joint[0] not in order))


_LIMBS: JointList = (*_LEFT_ARM, *_mirrored(_LEFT_ARM), *_LEFT_LEG, *_mirrored(_LEFT_LEG))
_COCO17 = _in_order(
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_wrist"
    " right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle",
    (*_TRUNK, *_NOSE, *_EYES, *_EARS, *_LIMBS),
)
_LEFT_OF_33: JointList = (
    ("left_eye_inner", "head", (0.2, 0.35, 0.92)), ("left_eye_outer", "head", (0.5, 0.33, 0.8)),
    ("mouth_left", "head", (0.25, -0.35, 0.9)), ("left_pinky", "left_wrist", (0.92, 0.0, -0.39)),
    ("left_index", "left_wrist", (0.98, 0.0, 0.2)), ("left_thumb", "left_wrist", (0.7, -0.1, 0.7)),
    ("left_heel", "left_ankle", (0.0, -0.55, -0.84)), ("left_toe", "left_ankle", (0.0, -0.35, 0.94)),
)  # fmt: skip
_MEDIAPIPE33 = _in_order(
    "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear"
    " mouth_left mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist"
    " left_pinky right_pinky left_index right_index left_thumb right_thumb left_hip right_hip left_knee"
    " right_knee left_ankle right_ankle left_heel right_heel left_toe right_toe",
    (*_TRUNK, *_NOSE, *_EYES, *_EARS, *_LIMBS, *_LEFT_OF_33, *_mirrored(_LEFT_OF_33)),
)
_LEFT_FOOT_OF_26: JointList = (
    ("left_big_toe", "left_ankle", (0.0, -0.35, 0.94)), ("left_small_toe", "left_ankle", (0.35, -0.35, 0.87)),
    ("left_heel", "left_ankle", (0.0, -0.55, -0.84)),
)  # fmt: skip
_HALPE26 = _in_order(
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_wrist"
    " right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle head neck hip left_big_toe"
    " right_big_toe left_small_toe right_small_toe left_heel right_heel",
    (*_TRUNK, *_NOSE, *_EYES, *_EARS, *_LIMBS, *_LEFT_FOOT_OF_26, *_mirrored(_LEFT_FOOT_OF_26)),
)


def _of_smpl(layout: str) -> JointList:
    names, parents, offsets = LAYOUTS[layout], parents_of(layout), neutral_joints(layout).offsets
    return tuple(
        (name, names[parent] if parent >= 0 else "", offset)
        for name, parent, offset in zip(names, parents, offsets, strict=True)
    )


# The names that --skeleton accepts: SMPL with 22 (HumanML3D) or 24 joints, Human3.6M's 17, Kinect's 25, MediaPipe's
# 33 landmarks, COCO's 17, Halpe's 26 (Pose2Sim; OpenPose's 25 are among them).
LISTS = {
    "smpl22": partial(_of_smpl, "body"), "smpl24": partial(_of_smpl, "smpl"), "smplh52": partial(_of_smpl, "smplh"),
    "h36m17": lambda: _H36M17, "kinect25": lambda: _KINECT25, "mediapipe33": lambda: _MEDIAPIPE33,
    "coco17": lambda: _COCO17, "halpe26": lambda: _HALPE26,
}  # fmt: skip
# Lists of landmarks: the joints that are the midpoint of two others where the data lack them. A file may hold only
# some of the joints of these lists.
MIDPOINTS = {"mediapipe33": _TRUNK_MIDPOINTS, "coco17": _TRUNK_MIDPOINTS, "halpe26": _TRUNK_MIDPOINTS}
# Other names of joints of these lists, in lower case without separators.
ALIASES = {
    "midhip": "hip", "chip": "hip", "hips": "hip", "pelvis": "hip", "midshoulder": "neck", "headtop": "head",
    "leftfootindex": "left_toe", "rightfootindex": "right_toe",
}  # fmt: skip


def measured_joints(title: str) -> list[str]:
    """Names of the joints that data without names hold, in their order."""
    if title == "halpe26":
        return [name for name, *_ in _HALPE26]
    return [name for name, *_ in LISTS[title]() if name not in MIDPOINTS.get(title, {})]
