"""Pairs of left and right joints: by names if they state the side, else by the shape of the limbs."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from stages.shared.humanoid.body_groups import LEFT_ARM, LEFT_LEG, RIGHT_ARM, RIGHT_LEG
from stages.shared.humanoid.joint_names import LEFT, RIGHT, sense_of

_MOST_PERMUTED = 5


def find_pairs(
    names: tuple[str, ...], parents: np.ndarray, offsets: np.ndarray, groups: np.ndarray
) -> tuple[tuple[int, int], ...]:
    """(left, right) joints, by the left one's index, without joints of the midline and joints without a partner.

    Args:
        names, parents (J,): the hierarchy. offsets: (J, 3) heads in the parents' frames, any unit.
        groups: (J,) body groups.
    """
    pairs = _pairs_by_name(names, groups)
    taken = {joint for pair in pairs for joint in pair}
    children: list[list[int]] = [[] for _ in names]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            children[int(parent)].append(joint)
    for left_group, right_group in ((LEFT_ARM, RIGHT_ARM), (LEFT_LEG, RIGHT_LEG)):
        tops = [_tops(parents, groups, group) for group in (left_group, right_group)]
        waiting = [(tops[0], tops[1])]
        while waiting:
            left, right = waiting.pop()
            for pair in _matched(left, right, offsets, children):
                waiting.append((children[pair[0]], children[pair[1]]))
                if not taken & set(pair):
                    pairs.append(pair)
                    taken |= set(pair)
    return tuple(sorted(pairs))


def _pairs_by_name(names: tuple[str, ...], groups: np.ndarray) -> list[tuple[int, int]]:
    """Pairs of joints whose names differ only in the side, unless their body groups contradict it."""
    sides: dict[tuple[str, ...], dict[str, int]] = {}
    doubled: set[tuple[str, ...]] = set()
    for joint, name in enumerate(names):
        sense = sense_of(name)
        if sense.side:
            found = sides.setdefault(sense.words, {})
            if sense.side in found:
                doubled.add(sense.words)
            found[sense.side] = joint
    mirrored = {0: 0, LEFT_ARM: RIGHT_ARM, LEFT_LEG: RIGHT_LEG, -1: -1}
    pairs = []
    for words, found in sides.items():
        if words in doubled or len(found) < 2:
            continue
        left, right = found[LEFT], found[RIGHT]
        if mirrored.get(int(groups[left])) == int(groups[right]):
            pairs.append((left, right))
    return pairs


def _tops(parents: np.ndarray, groups: np.ndarray, group: int) -> list[int]:
    return [
        int(joint)
        for joint in np.flatnonzero(groups == group)
        if parents[joint] < 0 or groups[parents[joint]] != group
    ]


def _matched(
    left: list[int], right: list[int], offsets: np.ndarray, children: list[list[int]]
) -> list[tuple[int, int]]:
    """Match siblings of one side with those of the other by the least difference of lengths and mutual distances.

    Mirroring changes neither, whatever the joints' own axes are. Many siblings are matched by length alone.
    """
    if not left or not right:
        return []
    if max(len(left), len(right)) > _MOST_PERMUTED:
        left, right = (sorted(side, key=lambda j: -float(np.linalg.norm(offsets[j]))) for side in (left, right))
        return list(zip(left, right, strict=False))
    swapped = len(left) > len(right)
    few, many = (right, left) if swapped else (left, right)
    best = min(
        permutations(range(len(many)), len(few)), key=lambda order: _misfit(few, many, order, offsets, children)
    )
    pairs = [(joint, many[index]) for joint, index in zip(few, best, strict=True)]
    return [(b, a) for a, b in pairs] if swapped else pairs


def _misfit(
    few: list[int], many: list[int], order: tuple[int, ...], offsets: np.ndarray, children: list[list[int]]
) -> float:
    other = [many[index] for index in order]
    mine, theirs = offsets[few], offsets[other]
    size = max(float(np.linalg.norm(mine, axis=1).max()), 1e-9)
    gaps = [np.linalg.norm(points[:, None] - points[None], axis=-1) for points in (mine, theirs)]
    lengths = np.abs(np.linalg.norm(mine, axis=1) - np.linalg.norm(theirs, axis=1)).sum()
    built = sum(len(children[a]) != len(children[b]) for a, b in zip(few, other, strict=True))
    late = sum(abs(index - place) for place, index in enumerate(order))
    return float((lengths + np.abs(gaps[0] - gaps[1]).sum() / 2) / size) + built + 1e-6 * late


def pairs_of_limbs(
    names: tuple[str, ...], parents: np.ndarray, offsets: np.ndarray, groups: np.ndarray
) -> tuple[np.ndarray, ...]:
    """The pairs of the arms and those of the legs, each (P, 2) left and right; collar bones are of the arms, toes of
    the legs. Limbs without pairs are left out.

    Args: as `find_pairs`.
    """
    pairs = find_pairs(names, parents, offsets, groups)
    limbs = (_pairs_along(pairs, parents, groups, group) for group in (LEFT_ARM, LEFT_LEG))
    return tuple(limb for limb in limbs if len(limb))


def _pairs_along(
    pairs: tuple[tuple[int, int], ...], parents: np.ndarray, groups: np.ndarray, group: int
) -> np.ndarray:
    """(P, 2) pairs whose left joint is of a group, or above or below a left joint of a pair that is."""
    own = {left for left, _ in pairs if groups[left] == group}
    lefts = {left for left, _ in pairs}
    found = set(own)
    for joint in own:
        while (joint := int(parents[joint])) in lefts:
            found.add(joint)
    for joint in sorted(lefts):
        if int(parents[joint]) in found:
            found.add(joint)
    return np.array([pair for pair in pairs if pair[0] in found], np.int64).reshape(-1, 2)
