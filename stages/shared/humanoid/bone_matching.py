"""Matching the bones of two humanoids without using names, for any number of bones.

Limbs are matched by a monotone alignment of their bones' lengths, in units of the leg's length. A bone may match
several (a forearm split for its twist), or none at a limb's ends (a clavicle, toes). Spines are matched by position:
pelvis to pelvis, the bone that the arms hang on to its counterpart, head to head, and bones between by their fraction
of the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Skeleton

SPINE = BODY_GROUPS.index("spine")
LIMBS = tuple(group for group in range(len(BODY_GROUPS)) if group != SPINE)
ARMS = tuple(BODY_GROUPS.index(name) for name in ("left_arm", "right_arm"))
LEGS = tuple(BODY_GROUPS.index(name) for name in ("left_leg", "right_leg"))
_SKIP = 0.4  # cost of an unmatched bone at a limb's end; a match costs |log| of the ratio of lengths
_SPLIT = 0.4  # cost of each further bone matched to the same one


class Piece(NamedTuple):
    """Bones of one limb that match each other; each tuple in order down the limb."""

    source: tuple[int, ...]
    target: tuple[int, ...]


@dataclass(frozen=True)
class Spine:
    """A spine's bones and their positions: 0 at the pelvis, 1 at the bone that the arms hang on, 2 at the head."""

    bones: tuple[int, ...]
    places: np.ndarray


def bones_of(skeleton: Skeleton, group: int) -> tuple[int, ...]:
    """The sampled bones of a body group, parents before children.

    Raises: InputError if the group has none.
    """
    bones = tuple(int(bone) for bone in np.flatnonzero((skeleton.groups == group) & skeleton.sampled))
    if not bones:
        raise InputError(
            f"The skeleton has no bone in its {BODY_GROUPS[group].replace('_', ' ')}.",
            "Look at it with pumps inspect.",
        )
    return bones


def match_limb(source: Skeleton, target: Skeleton, group: int) -> tuple[Piece, ...]:
    """The matching bones of a limb. A bone of the target that is in no piece has no match."""
    theirs, ours = bones_of(source, group), bones_of(target, group)
    pairs = align_lengths(lengths_in_legs(source, theirs), lengths_in_legs(target, ours))
    return tuple(Piece(tuple(theirs[i] for i in some), tuple(ours[j] for j in others)) for some, others in pairs)


def lengths_in_legs(skeleton: Skeleton, bones: tuple[int, ...]) -> tuple[float, ...]:
    """Lengths of bones in units of the leg's length, so that bodies of any size compare."""
    leg = np.mean([bone_lengths(skeleton, bones_of(skeleton, leg)).sum() for leg in LEGS])
    return tuple(float(length) for length in np.maximum(bone_lengths(skeleton, bones) / leg, 1e-4))


def bone_lengths(skeleton: Skeleton, bones: tuple[int, ...]) -> np.ndarray:
    """(N,) metres."""
    return np.linalg.norm(skeleton.tails[list(bones)], axis=1)


def size_ratio(source: Skeleton, target: Skeleton) -> float:
    """Length of the target's legs over the source's: of each leg the two longest matching bones, thigh and shin."""
    lengths = []
    for leg in LEGS:
        pieces = match_limb(source, target, leg)
        pairs = [(bone_lengths(source, p.source).sum(), bone_lengths(target, p.target).sum()) for p in pieces]
        lengths += sorted(pairs, key=lambda pair: -pair[1])[:2]
    theirs, ours = np.sum(lengths, axis=0)
    return float(ours / theirs)


def align_lengths(
    source: tuple[float, ...], target: tuple[float, ...]
) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """The monotone alignment of two lists of lengths with the least cost: pairs of places in both lists."""

    @cache
    def best(i: int, j: int, begun: bool) -> tuple[float, tuple]:
        if i == len(source) or j == len(target):
            return _SKIP * (len(source) - i + len(target) - j), ()
        choices: list[tuple[float, tuple]] = []
        if not begun:  # bones at the limb's beginning may have no match
            for a, b in ((i + 1, j), (i, j + 1)):
                cost, pieces = best(a, b, False)
                choices.append((cost + _SKIP, pieces))
        for more in range(1, max(len(source) - i, len(target) - j) + 1):
            for a, b in {(i + more, j + 1), (i + 1, j + more)}:
                if a <= len(source) and b <= len(target):
                    ratio = abs(np.log(sum(source[i:a]) / sum(target[j:b])))
                    cost, pieces = best(a, b, True)
                    piece = (tuple(range(i, a)), tuple(range(j, b)))
                    choices.append((cost + ratio + _SPLIT * (more - 1), (piece, *pieces)))
        return min(choices, key=lambda choice: choice[0])

    return list(best(0, 0, False)[1])


def spine_of(skeleton: Skeleton) -> Spine:
    """The bones of the spine and the position of each."""
    bones = _spine_bones(skeleton)
    carrier = bones.index(carrier_of(skeleton))
    lengths = bone_lengths(skeleton, bones)
    middles = np.cumsum(lengths) - lengths / 2
    last = len(bones) - 1
    anchors = {0: 0.0, carrier: 1.0, last: 2.0} if carrier < last else {0: 0.0, last: 1.0}
    if carrier == 0:
        anchors = {0: 0.0, last: 2.0} if last else {0: 0.0}
    known = sorted(anchors)
    places = np.interp(middles, middles[known], [anchors[bone] for bone in known])
    return Spine(bones, places)


def carrier_of(skeleton: Skeleton) -> int:
    """The bone of the spine that the arms hang on; the higher one if they hang on two."""
    spine = _spine_bones(skeleton)
    found = []
    for arm in ARMS:
        joint = bones_of(skeleton, arm)[0]
        while joint >= 0 and joint not in spine:
            joint = int(skeleton.parents[joint])
        found.append(joint if joint >= 0 else spine[-1])
    return max(found)


def _spine_bones(skeleton: Skeleton) -> tuple[int, ...]:
    return tuple(
        sorted({skeleton.root, *bones_of(skeleton, SPINE)})
    )  # the pelvis turns, whether or not it has a bone
