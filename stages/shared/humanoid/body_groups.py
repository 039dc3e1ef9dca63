"""The body group of each joint, for any humanoid: by names if they identify the limbs, else by topology.

A humanoid has two legs and two arms, each a branch of the tree; the rest of the pelvis' subtree is the spine. Joints
off the main chains (fingers, face, twists, props) belong to their limb's group, but point clouds have no points on
them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import NO_GROUP
from stages.shared.humanoid.certainty import SURE_BY_NAMES, sure_of_margin
from stages.shared.humanoid.joint_names import LEFT, RIGHT, NameSense, sense_of
from stages.shared.humanoid.joint_tree import JointTree
from stages.shared.humanoid.limb_search import find_four_limbs

SPINE, LEFT_ARM, RIGHT_ARM, LEFT_LEG, RIGHT_LEG = range(5)
_JUNK = ("finger", "face", "end", "helper")
_LEAST_OF_LIMB = 0.5  # of the longest limb's reach: another one of this size is a limb too
_OF_ANIMALS = {"fin", "fins", "wing", "wings", "tentacle", "pincer", "hoof", "paw", "beak", "snout", "antenna"}


@dataclass(frozen=True)
class BodyParts:
    """The parts found on a skeleton.

    groups:  (J,) int8 body group, NO_GROUP above or beside the pelvis' subtree.
    pelvis:  the topmost joint of the body.
    chains:  for each group the main chain of joints, from the first to the last (hand, toes, head).
    sided:   False if left and right are a guess, since no name states them.
    margin:  0 to 1, of the limbs over the next best choice; None if names identify them.
    """

    groups: np.ndarray
    pelvis: int
    chains: tuple[tuple[int, ...], ...]
    sided: bool
    margin: float | None = None

    @property
    def sure(self) -> float:
        """0 to 1: how often bodies that were found in this way are right (`stages.shared.humanoid.certainty`)."""
        return SURE_BY_NAMES if self.margin is None else sure_of_margin(self.margin)

    def mirrored(self) -> BodyParts:
        """The same parts with left and right swapped."""
        return self._swapped(np.array([0, 2, 1, 4, 3, NO_GROUP], np.int8))

    def with_arms_exchanged(self) -> BodyParts:
        """The same parts with only the left and right arm swapped."""
        return self._swapped(np.array([0, 2, 1, 3, 4, NO_GROUP], np.int8))

    def _swapped(self, swap: np.ndarray) -> BodyParts:
        chains = tuple(self.chains[group] for group in swap[:5])
        return replace(self, groups=swap[self.groups], chains=chains)


def find_body_parts(names: tuple[str, ...], parents: np.ndarray, offsets: np.ndarray, ends: np.ndarray) -> BodyParts:
    """Assign body groups.

    Args:
        names, parents (J,): the hierarchy, parents before children.
        offsets: (J, 3) heads in the parents' frames, any unit.
        ends: (J,) length of each joint's End Site, 0 if there is none.
    Raises: InputError if two legs and two arms are not found.
    """
    senses = [sense_of(name) for name in names]
    lengths = np.linalg.norm(offsets, axis=1)
    tree = JointTree(parents, lengths, np.asarray(ends, float), [sense.part in _JUNK for sense in senses])
    limbs = _limbs_by_name(tree, senses)
    sided, margin = limbs is not None, None
    found = _too_many_by_name(tree, senses, names)
    if limbs is None or found:
        found = found or _animal_by_name(senses, names) or find_four_limbs(tree, names)
        if isinstance(found, str):
            raise InputError(
                f"The skeleton is not a humanoid that can be recognised, with two legs and two arms: it {found}.",
                "If it is one, name the joints of its limbs with --skeleton-map, or rename them (LeftUpLeg, ...).",
            )
        legs, arms, margin = found.legs, found.arms, found.margin
        limbs = {LEFT_ARM: arms.first, RIGHT_ARM: arms.second, LEFT_LEG: legs.first, RIGHT_LEG: legs.second}
    pelvis = _pelvis_of(tree, senses, limbs)
    return parts_from_limbs(tree, senses, pelvis, limbs, sided=sided, margin=margin)


def parts_from_limbs(
    tree: JointTree, senses: list[NameSense], pelvis: int, limbs: dict[int, int], *, sided: bool, margin: float | None
) -> BodyParts:
    """Groups and chains from the first joints of the body and of its limbs."""
    groups = np.full(len(tree.parents), NO_GROUP, np.int8)
    groups[tree.subtree(pelvis)] = SPINE
    chains: list[tuple[int, ...]] = [()] * 5
    for group, joint in limbs.items():
        groups[tree.subtree(joint)] = group
        chains[group] = tuple(tree.main_chain(joint, limb=True))
    chains[SPINE] = _spine_chain(tree, senses, pelvis, limbs)
    return BodyParts(groups, pelvis, tuple(chains), sided, margin)


def _limbs_by_name(tree: JointTree, senses: list[NameSense]) -> dict[int, int] | None:
    """First joint of each limb, by group; None if names do not identify all four."""
    limbs: dict[int, int] = {}
    for group, part, side in (
        (LEFT_ARM, "arm", LEFT),
        (RIGHT_ARM, "arm", RIGHT),
        (LEFT_LEG, "leg", LEFT),
        (RIGHT_LEG, "leg", RIGHT),
    ):
        tops = _tops(tree, senses, part, side)
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


def _tops(tree: JointTree, senses: list[NameSense], part: str, side: str) -> list[int]:
    """The first joints of all branches that are named as this part of this side."""
    named = {j for j, sense in enumerate(senses) if sense.part == part and sense.side == side}
    return [joint for joint in named if not named & set(tree.ancestors(joint)[1:])]


def _too_many_by_name(tree: JointTree, senses: list[NameSense], names: tuple[str, ...]) -> str:
    """The reason, if names state several legs or several arms of one size on both sides, as a crab's; else ""."""
    for part in ("leg", "arm"):
        several = []
        for side in (LEFT, RIGHT):
            tops = [joint for joint in _tops(tree, senses, part, side) if len(tree.main_chain(joint, limb=True)) > 1]
            longest = max((tree.reach[joint] for joint in tops), default=0.0)
            several.append([joint for joint in tops if tree.reach[joint] > _LEAST_OF_LIMB * longest])
        if min(len(side) for side in several) > 1:
            first, second = (names[joint] for joint in sorted(several[0])[:2])
            return f"has {len(several[0])} {part}s on each side, such as {first} and {second}"
    return ""


def _animal_by_name(senses: list[NameSense], names: tuple[str, ...]) -> str:
    """The reason, if a joint is named as a limb that people do not have; else ""."""
    for sense, name in zip(senses, names, strict=True):
        if _OF_ANIMALS & set(sense.words):
            return f"has {name}, which is a part of animals"
    return ""


def _pelvis_of(tree: JointTree, senses: list[NameSense], limbs: dict[int, int]) -> int:
    """The joint where the four limbs meet, or its parent if that is named as the pelvis.

    If no name says hip, a short bone that leads to that joint is the pelvis' bone.
    """
    pelvis = tree.common_ancestor(list(limbs.values()))
    above = tree.parents[pelvis]
    if above < 0 or senses[pelvis].part == "hip" or tree.lengths[pelvis] >= 0.25 * tree.reach[limbs[LEFT_LEG]]:
        return pelvis
    if any(sense.part == "hip" for sense in senses):
        return above if senses[above].part == "hip" else pelvis
    return above if tree.lengths[pelvis] > 0 and len(tree.children[above]) == 1 else pelvis


def _spine_chain(tree: JointTree, senses: list[NameSense], pelvis: int, limbs: dict[int, int]) -> tuple[int, ...]:
    """The joints from the pelvis to the one where the arms branch off, and on to the head."""
    chest = tree.common_ancestor([limbs[LEFT_ARM], limbs[RIGHT_ARM]])
    path = [joint for joint in reversed(tree.ancestors(chest)) if joint >= pelvis and pelvis in tree.ancestors(joint)]
    limbed = {joint for first in limbs.values() for joint in tree.ancestors(first)}
    while senses[path[-1]].part != "head":
        onward = [
            child
            for child in tree.children[path[-1]]
            if not tree.skipped[child] and child not in limbed and senses[child].part not in ("leg", "arm")
        ]
        if not onward:
            break
        heads = [child for child in onward if _leads_to_a_head(tree, senses, child)]
        if not heads and path[-1] != chest and len(onward) > 1 and _are_a_pair(tree, onward):
            break  # eyes: what lies on the midline does not go on to one side
        path.append(max(heads or onward, key=tree.branch_length))
    return tuple(path)


def _leads_to_a_head(tree: JointTree, senses: list[NameSense], joint: int) -> bool:
    return any(senses[below].part in ("head", "neck") for below in tree.subtree(joint))


def _are_a_pair(tree: JointTree, joints: list[int]) -> bool:
    """Whether the two longest of these branches are similar."""
    longer, shorter = sorted((tree.branch_length(joint) for joint in joints), reverse=True)[:2]
    return shorter > 0.7 * longer
