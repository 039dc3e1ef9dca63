"""Names of parts of the body on a rig: body groups, their unions, the root, ends of limbs, and single joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Skeleton
from stages.shared.kinematics.foot_contacts import LEGS, find_feet
from stages.shared.kinematics.joint_tree import pelvis_and_above

POSITION, ROOT = "position", "root"
_UNIONS = {"arms": ("left_arm", "right_arm"), "legs": ("left_leg", "right_leg")}
_ENDS = {"left_hand": "left_arm", "right_hand": "right_arm", "left_foot": "left_leg", "right_foot": "right_leg"}
PARTS = (*BODY_GROUPS, *_UNIONS, "upper_body", "lower_body", ROOT, POSITION)
END_EFFECTORS = (*_ENDS, "head")
FOREARM = 0.75  # of the bone before it: a last bone that is longer is no hand or foot, but a forearm or shin


@dataclass(frozen=True)
class RigPart:
    """joints: (J,) bool, whose rotations belong to the part. position: whether the pelvis' place does."""

    joints: np.ndarray
    position: bool


def placing_joints(skeleton: Skeleton) -> np.ndarray:
    """(J,) bool: the pelvis and the joints above it."""
    return pelvis_and_above(skeleton.parents, skeleton.root)


def rig_part(skeleton: Skeleton, names: str, what: str) -> RigPart:
    """The union of parts, whose names are joined by commas.

    `root` is the pelvis' place and rotation, and the rotations above it; `position` is its place alone. `spine` is
    its body group with the pelvis' rotation, neck and head. `lower_body` is the legs and the root, `upper_body` is
    all other joints. A name that is none of `PARTS` is a joint's.

    Raises: InputError for a part that the rig does not have.
    """
    joints, position = np.zeros(skeleton.joints, bool), False
    wanted = [name.strip() for name in names.split(",") if name.strip()]
    if not wanted:
        raise InputError(f"{what} names no part of the body.", f"Parts are {', '.join(PARTS)}, and joints.")
    for name in wanted:
        own, placed = _one(skeleton, name, what)
        joints |= own
        position |= placed
    return RigPart(joints, position)


def _one(skeleton: Skeleton, name: str, what: str) -> tuple[np.ndarray, bool]:
    above = placing_joints(skeleton)
    legs = np.isin(skeleton.groups, LEGS)
    none = np.zeros(skeleton.joints, bool)
    if name == POSITION:
        return none, True
    if name == ROOT:
        return above, True
    if name == "lower_body":
        return legs | above, True
    if name == "upper_body":
        return ~(legs | above), False
    groups = _UNIONS.get(name, (name,) if name in BODY_GROUPS else ())
    if groups:
        joints = np.isin(skeleton.groups, [BODY_GROUPS.index(group) for group in groups])
        if not joints.any():
            raise InputError(f"{what}: the rig has no {name.replace('_', ' ')}.", "Look at it with pumps inspect.")
        return joints, False
    return _joint(skeleton, name, what), False


def _joint(skeleton: Skeleton, name: str, what: str) -> np.ndarray:
    found = np.array([each == name for each in skeleton.names])
    if not found.any():
        shown = ", ".join(skeleton.names[:8]) + (", ..." if skeleton.joints > 8 else "")
        raise InputError(
            f"{what}: the rig has no part or joint {name!r}.",
            f"Parts are {', '.join(PARTS)}; its joints are {shown}.",
        )
    return found


@dataclass(frozen=True)
class EndEffector:
    """A point of the body: a joint's head, or the tail of its bone.

    tail: (3,) metres from the head in the joint's frame; zeros for the head.
    """

    joint: int
    tail: np.ndarray

    @property
    def is_head(self) -> bool:
        """Whether the point is the joint's head, which the joint's own turns do not move."""
        return not self.tail.any()

    def limb(self, skeleton: Skeleton) -> list[int]:
        """Joints whose turns move the point: from the first of its body group below the pelvis on."""
        chain, joint = [], int(skeleton.parents[self.joint]) if self.is_head else self.joint
        while joint >= 0 and joint != skeleton.root and skeleton.groups[joint] == skeleton.groups[self.joint]:
            chain.append(joint)
            joint = int(skeleton.parents[joint])
        return chain[::-1]


def end_effector(skeleton: Skeleton, name: str, what: str) -> EndEffector:
    """An end effector by its name.

    A hand is the wrist: the last joint of the arm that points are drawn on, or the tail of that joint's bone if this
    is a forearm. A foot is likewise the ankle, and the head is the last such joint of the spine. Any other name is a
    joint's and means its head.

    Raises: InputError for an end that the rig does not have.
    """
    joint = _end_joint(skeleton, name, what)
    tail = skeleton.tails[joint]
    is_limb = name in _ENDS and np.linalg.norm(tail) > FOREARM * np.linalg.norm(skeleton.offsets[joint])
    return EndEffector(joint, np.array(tail if is_limb else np.zeros(3), np.float64))


def _end_joint(skeleton: Skeleton, name: str, what: str) -> int:
    if name in ("left_foot", "right_foot"):
        feet = find_feet(skeleton)
        group = BODY_GROUPS.index(_ENDS[name])
        return int(feet.joints[feet.groups == group][0])
    group = BODY_GROUPS.index(_ENDS.get(name, "spine"))
    if name in END_EFFECTORS:
        members = np.flatnonzero((skeleton.groups == group) & skeleton.sampled)
        if not len(members):
            raise InputError(f"{what}: the rig has no {name.replace('_', ' ')}.", "Look at it with pumps inspect.")
        return int(members[-1])
    try:
        return int(np.flatnonzero(_joint(skeleton, name, what))[0])
    except InputError as error:
        raise InputError(error.message, f"Ends are {', '.join(END_EFFECTORS)}, and joints.") from None
