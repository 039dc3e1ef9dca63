"""Which joint belongs to which part of the body, for any humanoid: by names where they speak, else by topology.

Facts used: a humanoid has two legs and two arms, each a branch; the legs' branches are a pair of like length nearer
to the pelvis than the arms' pair; what is left of the pelvis' subtree is the spine. Joints off the main chains
(fingers, face, twists, props) belong to their limb but are not seen by point clouds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import NO_GROUP
from stages.kinematics.joint_names import LEFT, RIGHT, NameSense, sense_of

SPINE, LEFT_ARM, RIGHT_ARM, LEFT_LEG, RIGHT_LEG = range(5)
_JUNK = ("finger", "face", "end", "helper")


@dataclass(frozen=True)
class BodyParts:
    """The parts found on a skeleton.

    groups:  (J,) int8 body group, NO_GROUP above or beside the pelvis' subtree.
    pelvis:  the topmost joint of the body.
    chains:  per group the main chain of joints, from its first to its last (hand, toes, head).
    sided:   False where left and right are a guess, since no name told them.
    """

    groups: np.ndarray
    pelvis: int
    chains: tuple[tuple[int, ...], ...]
    sided: bool

    def mirrored(self) -> BodyParts:
        """The same parts with left and right exchanged."""
        swap = np.array([0, 2, 1, 4, 3, NO_GROUP], np.int8)
        spine, left_arm, right_arm, left_leg, right_leg = self.chains
        return BodyParts(swap[self.groups], self.pelvis, (spine, right_arm, left_arm, right_leg, left_leg), True)


class _Tree:
    """Reaches and kinship on a joint hierarchy, J joints, parents before children."""

    def __init__(self, parents: np.ndarray, lengths: np.ndarray, ends: np.ndarray, senses: list[NameSense]):
        self.parents = [int(parent) for parent in parents]
        self.lengths = lengths
        self.senses = senses
        joints = len(self.parents)
        self.children: list[list[int]] = [[] for _ in range(joints)]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.children[parent].append(joint)
        self.junk = [sense.part in _JUNK for sense in senses]
        self.reach = [float(end) for end in ends]
        for joint in reversed(range(joints)):
            # A twist or carpal joint inside a limb is no junk while the limb goes on below it.
            self.junk[joint] = self.junk[joint] and all(self.junk[child] for child in self.children[joint])
            for child in self.children[joint]:
                if not self.junk[child]:
                    self.reach[joint] = max(self.reach[joint], float(lengths[child]) + self.reach[child])

    def ancestors(self, joint: int) -> list[int]:
        """The joint itself, its parent, and so on up to joint 0."""
        line = [joint]
        while self.parents[line[-1]] >= 0:
            line.append(self.parents[line[-1]])
        return line

    def common_ancestor(self, joints: list[int]) -> int:
        shared = set(self.ancestors(joints[0]))
        for joint in joints[1:]:
            shared &= set(self.ancestors(joint))
        return max(shared)

    def subtree(self, joint: int) -> list[int]:
        inside = {joint}
        for other in range(joint + 1, len(self.parents)):
            if self.parents[other] in inside:
                inside.add(other)
        return sorted(inside)

    def main_chain(self, first: int, *, limb: bool) -> list[int]:
        """From `first` down the child of longest reach; in a limb a fan of three and more (fingers, toes) ends it."""
        chain = [first]
        while True:
            onward = [child for child in self.children[chain[-1]] if not self.junk[child]]
            if not onward or (limb and len(onward) >= 3):
                return chain
            chain.append(max(onward, key=lambda child: (float(self.lengths[child]) + self.reach[child], -child)))

    def branch_length(self, joint: int) -> float:
        return float(self.lengths[joint]) + self.reach[joint]


def find_body_parts(names: tuple[str, ...], parents: np.ndarray, offsets: np.ndarray, ends: np.ndarray) -> BodyParts:
    """Assign body groups.

    Args:
        names, parents (J,): the hierarchy, parents before children.
        offsets: (J, 3) heads in the parents' frames, any unit.
        ends: (J,) length of each joint's End Site, 0 where there is none.
    Raises: InputError where no two legs and two arms are found.
    """
    senses = [sense_of(name) for name in names]
    lengths = np.linalg.norm(offsets, axis=1)
    tree = _Tree(parents, lengths, np.asarray(ends, float), senses)
    limbs = _limbs_by_name(tree)
    sided = limbs is not None
    if limbs is None:
        limbs = _limbs_by_topology(tree)
    if limbs is None:
        raise InputError(
            "The skeleton is no humanoid that can be recognised: no two legs and two arms were found among its"
            f" {len(names)} joints.",
            "Name the limbs (LeftUpLeg, RightArm, ...) or take another rig.",
        )
    pelvis = _pelvis_of(tree, limbs)
    groups = np.full(len(names), NO_GROUP, np.int8)
    groups[tree.subtree(pelvis)] = SPINE
    chains: list[tuple[int, ...]] = [()] * 5
    for group, joint in limbs.items():
        groups[tree.subtree(joint)] = group
        chains[group] = tuple(tree.main_chain(joint, limb=True))
    chains[SPINE] = _spine_chain(tree, pelvis, limbs)
    return BodyParts(groups, pelvis, tuple(chains), sided)


def _limbs_by_name(tree: _Tree) -> dict[int, int] | None:
    """First joint of each limb, by group, or None where names do not tell all four."""
    limbs: dict[int, int] = {}
    for group, part, side in (
        (LEFT_ARM, "arm", LEFT),
        (RIGHT_ARM, "arm", RIGHT),
        (LEFT_LEG, "leg", LEFT),
        (RIGHT_LEG, "leg", RIGHT),
    ):
        named = {j for j, sense in enumerate(tree.senses) if sense.part == part and sense.side == side}
        tops = [joint for joint in named if not named & set(tree.ancestors(joint)[1:])]
        if not tops:
            return None
        limbs[group] = max(tops, key=tree.branch_length)
    for first in limbs.values():
        if any(other != first and other in tree.ancestors(first) for other in limbs.values()):
            return None
    for left, right in ((LEFT_ARM, RIGHT_ARM), (LEFT_LEG, RIGHT_LEG)):
        reaches = sorted((tree.reach[limbs[left]], tree.reach[limbs[right]]))
        if reaches[1] <= 0 or reaches[0] < 0.5 * reaches[1]:
            return None
    return limbs


def _limbs_by_topology(tree: _Tree) -> dict[int, int] | None:
    """The two longest pairs of sibling branches of like length; the pair nearer to joint 0 are the legs."""
    pairs: list[tuple[float, int, int]] = []
    for siblings in tree.children:
        for i, first in enumerate(siblings):
            for second in siblings[i + 1 :]:
                longer, shorter = sorted((tree.branch_length(first), tree.branch_length(second)), reverse=True)
                alike = len(tree.main_chain(first, limb=True)) == len(tree.main_chain(second, limb=True))
                if longer > 0 and shorter > 0.93 * longer and alike and tree.reach[first] > 0:
                    pairs.append((longer, first, second))
    pairs.sort(reverse=True)
    for i, (_, a, b) in enumerate(pairs):
        inside = set(tree.subtree(a)) | set(tree.subtree(b)) | set(tree.ancestors(a)) | set(tree.ancestors(b))
        for _, c, d in pairs[i + 1 :]:
            if c in inside or d in inside:
                continue
            depth_ab, depth_cd = len(tree.ancestors(a)), len(tree.ancestors(c))
            legs, arms = ((a, b), (c, d)) if depth_ab <= depth_cd else ((c, d), (a, b))
            return {LEFT_ARM: arms[0], RIGHT_ARM: arms[1], LEFT_LEG: legs[0], RIGHT_LEG: legs[1]}
    return None


def _pelvis_of(tree: _Tree, limbs: dict[int, int]) -> int:
    """Where the four limbs meet, or the joint named hips or pelvis that sits right above that place."""
    pelvis = tree.common_ancestor(list(limbs.values()))
    leg = tree.reach[limbs[LEFT_LEG]]
    above = tree.parents[pelvis]
    if (
        tree.senses[pelvis].part != "hip"
        and above >= 0
        and tree.senses[above].part == "hip"
        and tree.lengths[pelvis] < 0.25 * leg
    ):
        return above
    return pelvis


def _spine_chain(tree: _Tree, pelvis: int, limbs: dict[int, int]) -> tuple[int, ...]:
    """Pelvis, up to where the arms branch off, and on to the head."""
    chest = tree.common_ancestor([limbs[LEFT_ARM], limbs[RIGHT_ARM]])
    path = [joint for joint in reversed(tree.ancestors(chest)) if joint >= pelvis and pelvis in tree.ancestors(joint)]
    firsts = set(limbs.values())
    while tree.senses[path[-1]].part != "head":
        onward = [
            child
            for child in tree.children[path[-1]]
            if not tree.junk[child] and not firsts & set(tree.subtree(child))
        ]
        if not onward:
            break
        heads = [c for c in onward if any(tree.senses[j].part in ("head", "neck") for j in tree.subtree(c))]
        path.append(max(heads or onward, key=tree.branch_length))
    return tuple(path)
