"""The landmarks of a body that 2D pose detectors know, as places on the bones of any rig.

Joints of the limbs come from the rig's own chains. What no rig has a joint for (nose, eyes, ears, heels, the middle
of the back) is placed by the proportions of an average adult, in units of the rig's own leg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Skeleton
from stages.shared.humanoid.anatomy import parts_of_skeleton
from stages.shared.humanoid.body_groups import LEFT_ARM, LEFT_LEG, RIGHT_ARM, RIGHT_LEG, SPINE, BodyParts
from stages.shared.humanoid.bone_matching import align_lengths, bone_lengths, bones_of, lengths_in_legs
from stages.shared.humanoid.facing import BodyPoses, bone_tips, find_facing
from stages.shared.humanoid.joint_names import sense_of
from stages.shared.kinematics.rotations import conjugate, rotate

LANDMARKS = (
    "pelvis", "spine", "neck", "head", "head_top", "nose", "left_eye", "right_eye", "left_ear", "right_ear",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_heel", "right_heel", "left_toe", "right_toe",
)  # fmt: skip
_MOST_POSES = 64
# Places in the head, in lengths of the leg (hip to ankle), along the face's left, up and forward directions, from the
# joint where the head begins.
_FACE = {
    "head": (0.0, 0.10, 0.01), "head_top": (0.0, 0.23, 0.01), "nose": (0.0, 0.085, 0.13),
    "left_eye": (0.037, 0.12, 0.105), "right_eye": (-0.037, 0.12, 0.105),
    "left_ear": (0.088, 0.10, 0.01), "right_ear": (-0.088, 0.10, 0.01),
}  # fmt: skip
_HEEL = (0.0, -0.06, -0.055)  # from the ankle, in the same units, along the body's directions in a standing pose
_TOE = (0.0, -0.06, 0.19)  # the same, where a rig ends at the ankle
# Bones of an average adult's limbs, in units of the leg from hip to toes, and what begins or ends between them.
_ARM, _ARM_LENGTHS = ("collar", "shoulder", "elbow", "wrist", "hand"), (0.15, 0.29, 0.26, 0.16)
_LEG, _LEG_LENGTHS = ("hip", "knee", "ankle", "toe"), (0.42, 0.40, 0.17)
_LOWER_SHARE = 0.93  # forearm over upper arm, shin over thigh
# Words of joint names that state which joint it is.
_NAMED = {
    name: frozenset(words.split())
    for name, words in {
        "shoulder": "arm upperarm uparm humerus shldr oberarm",
        "elbow": "elbow forearm lowerarm lowarm radius unterarm",
        "wrist": "wrist hand", "hip": "upleg upperleg upperlegs thigh femur oberschenkel",
        "knee": "leg knee shin calf tibia lowerleg lowleg unterschenkel", "ankle": "ankle foot fuss",
    }.items()
}  # fmt: skip
Carried = tuple[int, np.ndarray]  # a joint, and a place in its frame


@dataclass(frozen=True)
class Landmarks:
    """Where each of `LANDMARKS` is on one skeleton.

    bones: (L,) index of the joint that carries it. offsets: (L, 3) metres, its place in that joint's own frame.
    """

    bones: np.ndarray
    offsets: np.ndarray

    def place(self, positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """Landmarks (T, L, 3) of poses: positions (T, J, 3) metres and global rotations (T, J, 4), in their world."""
        return positions[:, self.bones] + rotate(rotations[:, self.bones], self.offsets)


def landmarks_of(skeleton: Skeleton, positions: np.ndarray, rotations: np.ndarray) -> Landmarks:
    """The landmarks of a rig, of which some poses are known.

    Args:
        positions: (F, J, 3) metres. rotations: (F, J, 4) global, xyzw. The poses show where the body's front is,
            since the axes of a head or foot differ between rigs.

    Raises: InputError if the rig lacks a limb.
    """
    chosen = np.unique(np.linspace(0, len(positions) - 1, _MOST_POSES).round().astype(int))
    positions, rotations = positions[chosen].astype(np.float64), rotations[chosen].astype(np.float64)
    parts, _, _ = parts_of_skeleton(skeleton)
    lacking = [BODY_GROUPS[group].replace("_", " ") for group, chain in enumerate(parts.chains) if not chain]
    if lacking:
        raise InputError(f"The rig has no {lacking[0]}, so keypoints cannot be found on it.", "`pumps inspect` it.")
    body = _PosedRig(skeleton, positions, rotations, parts)
    found: dict[str, Carried] = {}
    for side, arm, leg in (("left", LEFT_ARM, LEFT_LEG), ("right", RIGHT_ARM, RIGHT_LEG)):
        body.add_limb(found, side, arm)
        body.add_limb(found, side, leg)
    body.add_trunk(found)
    body.add_face(found)
    rows = [found[name] for name in LANDMARKS]
    return Landmarks(np.array([bone for bone, _ in rows]), np.array([offset for _, offset in rows]))


class _PosedRig:
    """A rig in some poses, and the directions of its body in each."""

    def __init__(self, skeleton: Skeleton, positions: np.ndarray, rotations: np.ndarray, parts: BodyParts):
        self.skeleton, self.positions, self.rotations, self.parts = skeleton, positions, rotations, parts
        known = np.linalg.norm(skeleton.tails, axis=1) > 0
        facing = find_facing(BodyPoses(positions, bone_tips(positions, rotations, skeleton.tails, known)), parts)
        self.axes = np.stack([facing.left, facing.up, facing.forward], axis=1)  # (F, 3, 3), rows
        bones = bones_of(skeleton, LEFT_LEG)
        whole = bone_lengths(skeleton, bones).sum() / sum(lengths_in_legs(skeleton, bones))
        self.leg_m = float(whole * sum(_LEG_LENGTHS[:2]))

    def add_limb(self, found: dict[str, Carried], side: str, group: int) -> None:
        """The joints of an arm or leg: where the bones of an average limb begin and end along the rig's."""
        arm = group in (LEFT_ARM, RIGHT_ARM)
        names, lengths = (_ARM, _ARM_LENGTHS) if arm else (_LEG, _LEG_LENGTHS)
        bones = bones_of(self.skeleton, group)
        sizes = lengths_in_legs(self.skeleton, bones)
        for mine, theirs in align_lengths(lengths, sizes):
            own, other = np.array([lengths[i] for i in mine]), np.array([sizes[i] for i in theirs])
            marks = np.cumsum([0.0, *own]) / own.sum()
            ends = np.cumsum([0.0, *other]) / other.sum()
            for at, mark in zip((*mine, mine[-1] + 1), marks, strict=True):
                bone = min(int(np.searchsorted(ends, mark, side="right")) - 1, len(theirs) - 1)
                share = (mark - ends[bone]) / max(ends[bone + 1] - ends[bone], 1e-9)
                joint = bones[theirs[bone]]
                # The next piece begins at its own first joint, which is set after this one.
                found[f"{side}_{names[at]}"] = joint, share * self.skeleton.tails[joint]
        self._prefer_named(found, side, bones, names)
        if not arm:
            self._add_foot(found, side)

    def _prefer_named(self, found: dict[str, Carried], side: str, bones: Sequence[int], names: Sequence[str]) -> None:
        """Use joints that have the landmarks' names instead, if they follow one another along the limb."""
        named: dict[str, list[int]] = {}
        for bone in bones:
            word = "".join(word for word in sense_of(self.skeleton.names[bone]).words if not word.isdecimal())
            for name in names:
                if word in _NAMED.get(name, frozenset()):
                    named.setdefault(name, []).append(bone)
        upper, lower, end = names[-4:-1] if len(names) == 5 else names[:3]
        chosen = [named.get(name, [-1])[0] for name in (upper, lower)]
        if -1 in chosen or chosen[0] >= chosen[1]:
            return
        found[f"{side}_{upper}"], found[f"{side}_{lower}"] = ((bone, np.zeros(3)) for bone in chosen)
        below = [bone for bone in named.get(end, []) if bone > chosen[1]]
        if below:  # of a wrist and a hand the one that makes the forearm as long as it is in people
            long = _LOWER_SHARE * self._apart(*chosen)
            found[f"{side}_{end}"] = (
                min(below, key=lambda bone: abs(self._apart(chosen[1], bone) - long)),
                np.zeros(3),
            )

    def _apart(self, upper: int, lower: int) -> float:
        """Length along the rig from one joint to another below it."""
        length, joint = 0.0, lower
        while joint != upper and joint >= 0:
            length += float(np.linalg.norm(self.skeleton.offsets[joint]))
            joint = int(self.skeleton.parents[joint])
        return length

    def _add_foot(self, found: dict[str, Carried], side: str) -> None:
        ankle, at = found.get(f"{side}_ankle", found[f"{side}_hip"])
        found.setdefault(f"{side}_toe", (ankle, at + self._in_frame_of(ankle, _TOE)))
        found[f"{side}_heel"] = ankle, at + self._in_frame_of(ankle, _HEEL)

    def add_trunk(self, found: dict[str, Carried]) -> None:
        """Pelvis and neck midway between hips and shoulders, as detectors have them; the back midway between them."""
        for name, pair, bone in (
            ("pelvis", ("left_hip", "right_hip"), self.parts.pelvis),
            ("neck", ("left_shoulder", "right_shoulder"), self._chest()),
        ):
            places = [self._placed(*found[end]) for end in pair]
            found[name] = bone, self._local(bone, np.mean(places, axis=0))
        spine = list(self.parts.chains[SPINE])
        middle = (self._placed(*found["pelvis"]) + self._placed(*found["neck"])) / 2
        nearest = min(spine, key=lambda bone: float(np.linalg.norm(self.positions[:, bone] - middle, axis=1).mean()))
        found["spine"] = nearest, self._local(nearest, middle)

    def add_face(self, found: dict[str, Carried]) -> None:
        head = self.parts.chains[SPINE][-1]
        base = self._placed(*found["neck"])
        start = self.positions[:, head]
        # A rig whose last joint is the neck or the chest: the head begins a fifth of a leg above the shoulders.
        low = float(((start - base) * self.axes[:, 1]).sum(-1).mean()) < 0.05 * self.leg_m
        lift = np.array([0.0, 0.15, 0.02]) if low else np.zeros(3)
        origin = self._local(head, base) if low else np.zeros(3)
        for name, place in _FACE.items():
            found[name] = head, origin + self._in_frame_of(head, np.add(lift, place))

    def _chest(self) -> int:
        """The joint of the trunk that both arms hang on."""
        spine = set(self.parts.chains[SPINE])
        joint = self.parts.chains[LEFT_ARM][0]
        while joint >= 0 and joint not in spine:
            joint = int(self.skeleton.parents[joint])
        return joint if joint >= 0 else self.parts.chains[SPINE][-1]

    def _placed(self, bone: int, offset: np.ndarray) -> np.ndarray:
        return self.positions[:, bone] + rotate(self.rotations[:, bone], offset)

    def _local(self, bone: int, places: np.ndarray) -> np.ndarray:
        """(3,) median over the poses of places (F, 3), in a joint's frame."""
        return np.median(rotate(conjugate(self.rotations[:, bone]), places - self.positions[:, bone]), axis=0)

    def _in_frame_of(self, bone: int, place: tuple[float, float, float] | np.ndarray) -> np.ndarray:
        """(3,) metres: a vector in legs along the body's left, up and forward, in a joint's frame, mean of the poses.

        The trunk's directions are used as those of a head or foot: averaged over many poses, the two are nearly the
        same.
        """
        vector = self.leg_m * np.einsum("k,fkc->fc", np.asarray(place, float), self.axes)
        local = rotate(conjugate(self.rotations[:, bone]), vector).mean(axis=0)
        size = float(np.linalg.norm(local))
        return local * (self.leg_m * float(np.linalg.norm(place)) / size) if size > 0 else local
