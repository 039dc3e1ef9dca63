"""The anatomy of a rig: what is known of it as a body, how each fact was found, and how certain it is.

Found from a Skeleton and some of its poses. Reading a file does not need it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, NO_GROUP, Skeleton
from stages.shared.humanoid.body_groups import LEFT_ARM, LEFT_LEG, RIGHT_ARM, RIGHT_LEG, BodyParts, find_body_parts
from stages.shared.humanoid.facing import BodyPoses, Facing, bone_tips, find_facing
from stages.shared.humanoid.reference_pose import turn_to_y_up
from stages.shared.humanoid.symmetric_pairs import find_pairs

_END_NAMES = ("head", "left_hand", "right_hand", "left_foot", "right_foot")
_SWAPPED_BALANCE = -0.25
_UPRIGHT = 0.8


@dataclass(frozen=True)
class Finding:
    """How one fact was found. how: "names", "shape", "pose", "map" or "file". sure: certainty, 0 to 1."""

    value: str
    how: str
    sure: float


@dataclass(frozen=True)
class RigAnatomy:
    """A rig as a body, J joints.

    groups:        (J,) int8 body group, NO_GROUP outside the body.
    pelvis:        topmost joint of the body.
    chains:        for each group the joints that points are drawn along, from the first to the last.
    pairs:         (left, right) joints.
    end_effectors: "head", "left_hand", ... -> the last joint of that chain.
    unseen:        joints of the body without points (fingers, faces, twists, joints without length).
    outside:       joints that are not part of the body.
    up_axis:       the source's.
    facing:        (3,) unit vector in the source's axes, the forward direction at rest, or in the first pose if the
                   rest pose is not a human pose.
    unit_m:        metres in one unit of the source. stature_m: height of the joints in the most upright pose.
    rest:          kind of the pose at zero rotations: "T-pose", "A-pose", "arms down", "standing", "no human pose".
    findings:      "groups", "sides", "up", "facing", "rest" -> how it was found and how certain it is.
    """

    groups: np.ndarray
    pelvis: int
    chains: tuple[tuple[int, ...], ...]
    pairs: tuple[tuple[int, int], ...]
    end_effectors: dict[str, int]
    unseen: tuple[int, ...]
    outside: tuple[int, ...]
    up_axis: str
    facing: np.ndarray
    unit_m: float
    stature_m: float
    rest: str
    findings: dict[str, Finding]

    @property
    def sides_look_swapped(self) -> bool:
        """Whether the poses contradict the sides in the joint names."""
        return self.findings["sides"].value == "swapped"


def anatomy_of(
    skeleton: Skeleton, heads: np.ndarray, rotations: np.ndarray, spacing_s: float = 0.0, *, mapped: bool = False
) -> RigAnatomy:
    """The anatomy of a skeleton in F poses.

    Args:
        heads: (F, J, 3) joints, metres, Y up. rotations: (F, J, 4) global, xyzw.
        spacing_s: seconds from one pose to the next, 0 if they are not consecutive.
        mapped: True if the body parts come from a skeleton map of the user's.
    """
    parts, how, sure = parts_of_skeleton(skeleton, mapped)
    known = np.linalg.norm(skeleton.tails, axis=1) > 0
    poses = BodyPoses(heads, bone_tips(heads, rotations, skeleton.tails, known), spacing_s)
    moving = find_facing(poses, parts)
    rest_heads = _rest_of(skeleton)
    rest = _rest_name(rest_heads, parts)
    still = np.tile((0.0, 0.0, 0.0, 1.0), (1, skeleton.joints, 1))
    at_rest = BodyPoses(rest_heads[None], bone_tips(rest_heads[None], still, skeleton.tails, known))
    # The rest pose is in the source's axes, the motion is Y up.
    turn = turn_to_y_up(skeleton.up_axis)
    if rest == "no human pose":
        forward = moving.forward[0] if turn is None else turn.inv().apply(moving.forward[0])
    else:
        forward = find_facing(at_rest, parts).forward[0]
    seen = heads[:, skeleton.sampled]
    stature = float(np.percentile(np.ptp(seen[..., 1], axis=1), 90)) if seen.size else 0.0
    return RigAnatomy(
        groups=skeleton.groups,
        pelvis=skeleton.root,
        chains=parts.chains,
        pairs=find_pairs(skeleton.names, skeleton.parents, skeleton.offsets, skeleton.groups),
        end_effectors={name: chain[-1] for name, chain in zip(_END_NAMES, parts.chains, strict=True) if chain},
        unseen=tuple(int(j) for j in np.flatnonzero((skeleton.groups != NO_GROUP) & ~skeleton.sampled)),
        outside=tuple(int(j) for j in np.flatnonzero(skeleton.groups == NO_GROUP)),
        up_axis=skeleton.up_axis,
        facing=forward,
        unit_m=skeleton.unit_m,
        stature_m=stature,
        rest=rest,
        findings=_findings(skeleton, how, sure, moving, rest, forward),
    )


def _findings(
    skeleton: Skeleton, how: str, sure: float, moving: Facing, rest: str, forward: np.ndarray
) -> dict[str, Finding]:
    sides_how = {"names": "names", "map": "map"}.get(how, "pose")
    agreeing = moving.balance if sides_how == "pose" else max(moving.balance, 0.0)
    swapped = sides_how == "names" and moving.balance < _SWAPPED_BALANCE
    upright = float(np.clip(np.median(moving.up[:, 1]), 0, 1))
    source = "rest pose" if rest != "no human pose" else "first pose"
    return {
        "groups": Finding(f"{len(BODY_GROUPS)} groups", how, sure),
        "sides": Finding(
            "swapped" if swapped else "as told" if sides_how != "pose" else "found", sides_how,
            abs(moving.balance) if swapped or sides_how == "pose" else 1.0,
        ),
        "up": Finding(skeleton.up_axis, "pose", upright),
        "facing": Finding(direction_name(forward), source, abs(agreeing)),
        "rest": Finding(rest, "pose", 1.0),
    }  # fmt: skip


def direction_name(direction: np.ndarray) -> str:
    """The name of a direction: "+Z" and so on within 15 degrees of an axis, else its components."""
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) > np.cos(np.deg2rad(15)):
        return f"{'+' if direction[axis] > 0 else '-'}{'XYZ'[axis]}"
    return "(" + ", ".join(f"{value:.2f}" for value in direction) + ")"


def parts_of_skeleton(skeleton: Skeleton, mapped: bool = False) -> tuple[BodyParts, str, float]:
    """The skeleton's groups and chains, and how they were found."""
    how, sure = "map", 1.0
    if not mapped:
        try:
            ends = np.linalg.norm(skeleton.tails, axis=1)
            found = find_body_parts(skeleton.names, skeleton.parents, skeleton.offsets, ends)
            how, sure = "names" if found.sided else "shape", found.sure
        except InputError:
            pass
    chains = tuple(_chain_of(skeleton, group) for group in range(len(BODY_GROUPS)))
    return BodyParts(skeleton.groups, skeleton.root, chains, how != "shape"), how, sure


def _chain_of(skeleton: Skeleton, group: int) -> tuple[int, ...]:
    """The chain from a group's first joint to its deepest joint with points, including joints without length."""
    seen = np.flatnonzero((skeleton.groups == group) & skeleton.sampled)
    best: tuple[int, ...] = ()
    for joint in seen.tolist():
        line = [joint]
        while skeleton.parents[line[-1]] >= 0 and skeleton.groups[skeleton.parents[line[-1]]] == group:
            line.append(int(skeleton.parents[line[-1]]))
        best = max(best, tuple(reversed(line)), key=len)
    if not best:
        best = tuple(np.flatnonzero(skeleton.groups == group)[:1].tolist())
    return best


def _rest_of(skeleton: Skeleton) -> np.ndarray:
    """(J, 3) joints at zero rotations, metres, in the source's axes."""
    rest = np.zeros((skeleton.joints, 3))
    for joint in range(1, skeleton.joints):
        rest[joint] = rest[skeleton.parents[joint]] + skeleton.offsets[joint]
    return rest


def _rest_name(rest: np.ndarray, parts: BodyParts) -> str:
    """The kind of a pose, by the angles between trunk, legs and arms."""
    chains = parts.chains
    if not all(chains):
        return "no human pose"
    legs = [_direction(rest, chains[group]) for group in (LEFT_LEG, RIGHT_LEG)]
    arms = [
        _direction(rest, chains[group][-2:] if len(chains[group]) > 1 else chains[group])
        for group in (LEFT_ARM, RIGHT_ARM)
    ]
    middle = np.mean([rest[chains[group][0]] for group in (LEFT_ARM, RIGHT_ARM)], axis=0)
    hips = np.mean([rest[chains[group][0]] for group in (LEFT_LEG, RIGHT_LEG)], axis=0)
    trunk = middle - hips
    if not np.linalg.norm(trunk) > 0 or not all(np.linalg.norm(limb) > 0 for limb in (*legs, *arms)):
        return "no human pose"
    up = trunk / np.linalg.norm(trunk)
    if min(-leg @ up for leg in legs) < _UPRIGHT or max(abs(up @ np.eye(3)[axis]) for axis in range(3)) < _UPRIGHT:
        return "no human pose"
    across = rest[chains[LEFT_ARM][:2][-1]] - rest[chains[RIGHT_ARM][:2][-1]]
    aside = [float(arm @ across) / max(float(np.linalg.norm(across)), 1e-9) for arm in arms]
    if aside[0] * aside[1] > 0.25:
        return "no human pose"  # both arms to one side
    below = float(np.rad2deg(np.arcsin(np.clip([-(arm @ up) for arm in arms], -1, 1))).mean())
    if below > 65:
        return "arms down"
    if min(abs(value) for value in aside) < 0.4:
        return "standing"
    return "T-pose" if abs(below) < 25 else "A-pose" if below > 0 else "arms up"


def _direction(rest: np.ndarray, chain: tuple[int, ...]) -> np.ndarray:
    vector = rest[chain[-1]] - rest[chain[0]]
    size = np.linalg.norm(vector)
    return vector / size if size > 0 else vector
