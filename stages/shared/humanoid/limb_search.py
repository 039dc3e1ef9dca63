"""Finding two legs and two arms on a tree of bones without names, or the reason why it is not a humanoid.

A pair of limbs is two branches of one joint that are similar to each other and different from their other siblings. A
humanoid has two such pairs, one above the other: legs near the root of the tree, arms further on, where the head also
branches off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stages.shared.humanoid.joint_tree import JointTree

_MOST_BRANCHES = 8  # looked at below one joint, the longest first: skirts and hair have dozens
_LEAST_LENGTH_RATIO = 0.62
_LEAST_SIZE_RATIO = 0.35
_ARM_TO_LEG = (0.3, 1.6)
_LEAST_LEG_TO_TRUNK = 0.65  # 0.9 is the least of the rigs at hand, a game character with a large head
_MOST_TAIL_TO_LEG = 1.2


@dataclass(frozen=True)
class LimbPair:
    """Two similar branches `first` and `second` of the joint `above`.

    length: of the shorter branch. value: length times similarity. twins: number of similar branches of `above`,
    including these two.
    """

    first: int
    second: int
    above: int
    length: float
    value: float
    twins: int


@dataclass(frozen=True)
class FourLimbs:
    """Legs and arms, sides unknown. margin: 0 to 1, over the next best choice."""

    legs: LimbPair
    arms: LimbPair
    margin: float


def find_four_limbs(tree: JointTree, names: Sequence[str]) -> FourLimbs | str:
    """The limbs of a humanoid, or the reason why there are none, as the end of a sentence that begins with "it"."""
    pairs = _pairs_of(tree)
    found = [(legs.value + arms.value, legs, arms) for legs, arms in _combinations(tree, pairs)]
    if not found:
        return _reason(tree, pairs, names)
    found.sort(key=lambda item: (-item[0], item[1].first, item[2].first))
    best, legs, arms = found[0]
    third = _third_pair(tree, pairs, legs, arms)
    if third is not None:
        return f"has more than two pairs of limbs: there is another one at {names[third.above]}"
    strange = _strange_build(tree, legs, arms)
    if strange:
        return strange
    rivals = [value for value, *pair in found[1:] if {id(p) for p in pair} != {id(legs), id(arms)}]
    return FourLimbs(legs, arms, 1.0 - 0.8 * max(rivals, default=0.0) / best)


def _pairs_of(tree: JointTree) -> list[LimbPair]:
    pairs = []
    for above, children in enumerate(tree.children):
        branches = [child for child in children if not tree.skipped[child] and tree.reach[child] > 0]
        branches = sorted(branches, key=lambda child: -tree.branch_length(child))[:_MOST_BRANCHES]
        for i, a in enumerate(branches):
            for b in branches[i + 1 :]:
                likeness = _likeness(tree, a, b)
                if likeness > 0:
                    twins = 2 + sum(_likeness(tree, a, c) > 0.7 for c in branches if c not in (a, b))
                    length = min(tree.branch_length(a), tree.branch_length(b))
                    pairs.append(LimbPair(a, b, above, length, length * likeness, twins))
    return pairs


def _likeness(tree: JointTree, a: int, b: int) -> float:
    """0 to 1: similarity of two branches in length and structure."""
    shorter, longer = sorted((tree.branch_length(a), tree.branch_length(b)))
    smaller, larger = sorted((tree.sizes[a], tree.sizes[b]))
    if longer <= 0 or shorter < _LEAST_LENGTH_RATIO * longer or smaller < _LEAST_SIZE_RATIO * larger:
        return 0.0
    chains = sorted((tree.limb_joints[a], tree.limb_joints[b]))
    leaves = sorted((tree.leaves[a], tree.leaves[b]))  # a trunk is as long as a leg, but has more leaves
    return shorter / longer * (smaller / larger * leaves[0] / leaves[1]) ** 0.5 * (chains[0] / chains[1])


def _combinations(tree: JointTree, pairs: list[LimbPair]) -> list[tuple[LimbPair, LimbPair]]:
    """(legs, arms) for each two pairs that can be the legs and the arms of one body."""
    out = []
    longest = sorted(pairs, key=lambda pair: -pair.value)[:40]
    insides = {id(pair): {*tree.subtree(pair.first), *tree.subtree(pair.second)} for pair in longest}
    lines = {id(pair): set(tree.ancestors(pair.above)) for pair in longest}
    for near in longest:
        for far in longest:
            if far.above in insides[id(near)] or near.above in insides[id(far)] or max(near.twins, far.twins) > 2:
                continue
            if not _is_above(tree, near, lines[id(near)], lines[id(far)]):
                continue
            legs, arms = _legs_and_arms(tree, near, far)
            low, high = _ARM_TO_LEG
            if low * legs.length <= arms.length <= high * legs.length:
                out.append((legs, arms))
    return out


def _is_above(tree: JointTree, near: LimbPair, near_line: set[int], far_line: set[int]) -> bool:
    """Whether the path to the far pair begins at the near pair's joint, or at the parent of a short bone to it.

    The latter is a pelvis that is a branch of its own below the hips.
    """
    if near.above in far_line:
        return near_line != far_line
    meeting = max(near_line & far_line)
    aside = [joint for joint in near_line if joint > meeting]
    return len(near_line) <= len(far_line) and sum(tree.lengths[joint] for joint in aside) < 0.4 * near.length


def _legs_and_arms(tree: JointTree, near: LimbPair, far: LimbPair) -> tuple[LimbPair, LimbPair]:
    """Order two pairs as (legs, arms): the legs are nearer to the tree's first joint, unless it is in the chest.

    In that case the far pair's joint (the pelvis) has no other branch, while the near one's has the head.
    """
    onward = next((joint for joint in tree.ancestors(far.above) if tree.parents[joint] == near.above), None)
    if onward is None:
        return near, far
    beside_near = _beside(tree, near, onward)
    if _beside(tree, far, -1) == 0 and beside_near > 0.1 * near.length and near.length < 0.9 * far.length:
        return far, near
    return near, far


def _beside(tree: JointTree, pair: LimbPair, onward: int) -> float:
    """Length of the longest branch of the pair's joint besides the pair and the path to the other pair."""
    rest = [c for c in tree.children[pair.above] if c not in (pair.first, pair.second, onward)]
    return max((tree.branch_length(child) for child in rest if not tree.skipped[child]), default=0.0)


def _third_pair(tree: JointTree, pairs: list[LimbPair], legs: LimbPair, arms: LimbPair) -> LimbPair | None:
    """Another pair that is about as long as the limbs and part of neither, such as an insect's or wings."""
    taken = {j for pair in (legs, arms) for first in (pair.first, pair.second) for j in tree.subtree(first)}
    least = 0.75 * min(legs.length, arms.length)
    for pair in pairs:
        if pair.length <= least or pair.value <= 0.6 * pair.length or pair.twins > 2 or pair.above in taken:
            continue
        own = {*tree.subtree(pair.first), *tree.subtree(pair.second)}
        if not own & (taken | {legs.above, arms.above}):
            return pair
    return None


def _strange_build(tree: JointTree, legs: LimbPair, arms: LimbPair) -> str:
    """The reason, if the legs are too short for the trunk or a tail is longer than the legs; else ""."""
    line = tree.ancestors(arms.above)
    low = tree.ancestors(legs.above)
    onward = [child for child in tree.children[arms.above] if child not in (arms.first, arms.second, *low)]
    head = max((tree.branch_length(child) for child in onward), default=0.0)
    trunk = sum(tree.lengths[joint] for joint in line if joint not in low) + head
    if legs.length < _LEAST_LEG_TO_TRUNK * trunk:
        return f"has a trunk and head {trunk / legs.length:.1f} times as long as its legs, like a fish or a lizard"
    below = [child for child in tree.children[legs.above] if child not in (legs.first, legs.second, *line)]
    tail = max((tree.branch_length(child) for child in below), default=0.0)
    if tail > _MOST_TAIL_TO_LEG * legs.length:
        return f"has a tail {tail / legs.length:.1f} times as long as its legs"
    return ""


def _reason(tree: JointTree, pairs: list[LimbPair], names: Sequence[str]) -> str:
    joints = len(tree.parents)
    branching = [joint for joint in range(joints) if len(tree.children[joint]) > 1]
    if joints < 5:
        return f"has only {joints} joint{'s' if joints > 1 else ''}"
    if not branching:
        return f"is one chain of {joints} joints without any limb"
    fans = [pair for pair in pairs if pair.twins > 3]
    if fans:
        widest = max(fans, key=lambda pair: (pair.twins, pair.value))
        if widest.length > 0.3 * max(pair.length for pair in pairs):
            kind = f"{widest.twins} similar branches at {names[widest.above]}"
            return f"has {kind}, like a hand, a spider or a table"
    if not pairs:
        return "has no two branches that are similar"
    return "has only one pair of limbs" if len({pair.above for pair in pairs}) == 1 else "has no arms above its legs"
