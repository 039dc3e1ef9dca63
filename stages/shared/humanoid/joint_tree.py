"""A joint hierarchy with the lengths, ancestors and branches that the search for limbs needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


class JointTree:
    """A hierarchy of J joints, parents before children, with the lengths of its bones.

    Args:
        parents: (J,) index of each joint's parent, -1 for joint 0.
        lengths: (J,) distance of each joint from its parent, any unit.
        ends: (J,) length of each joint's End Site, 0 if there is none.
        skipped: (J,) True for joints that no chain may enter: those named as fingers, faces or helpers.
    """

    def __init__(self, parents: np.ndarray, lengths: np.ndarray, ends: np.ndarray, skipped: Sequence[bool] = ()):
        self.parents = [int(parent) for parent in parents]
        self.lengths = [float(length) for length in lengths]
        joints = len(self.parents)
        self.children: list[list[int]] = [[] for _ in range(joints)]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.children[parent].append(joint)
        self.skipped = list(skipped) or [False] * joints
        self.reach = [float(end) for end in ends]
        self.sizes = [1] * joints
        self.leaves = [0 if children else 1 for children in self.children]
        for joint in reversed(range(joints)):
            # A chain may pass through a twist or carpal joint if the limb continues below it.
            self.skipped[joint] = self.skipped[joint] and all(self.skipped[child] for child in self.children[joint])
            for child in self.children[joint]:
                self.sizes[joint] += self.sizes[child]
                self.leaves[joint] += self.leaves[child]
                if not self.skipped[child]:
                    self.reach[joint] = max(self.reach[joint], self.branch_length(child))
        self.limb_joints = [1] * joints  # number of joints of the main chain from here on, as a limb's
        for joint in reversed(range(joints)):
            onward = self._onward(joint)
            if onward is not None and not self.is_fan(joint):
                self.limb_joints[joint] += self.limb_joints[onward]

    def branch_length(self, joint: int) -> float:
        """Length of the longest path from the joint's parent through the joint to a leaf."""
        return self.lengths[joint] + self.reach[joint]

    def ancestors(self, joint: int) -> list[int]:
        """The joint itself and its ancestors, up to joint 0."""
        line = [joint]
        while self.parents[line[-1]] >= 0:
            line.append(self.parents[line[-1]])
        return line

    def common_ancestor(self, joints: Sequence[int]) -> int:
        """The lowest common ancestor of these joints; it may be one of them."""
        shared = set(self.ancestors(joints[0]))
        for joint in joints[1:]:
            shared &= set(self.ancestors(joint))
        return max(shared)

    def subtree(self, joint: int) -> list[int]:
        """The joint and all joints below it, in ascending order."""
        found, waiting = [], [joint]
        while waiting:
            found.append(waiting.pop())
            waiting += self.children[found[-1]]
        return sorted(found)

    def main_chain(self, first: int, *, limb: bool) -> list[int]:
        """The chain from `first` down, always to the child with the longest path below it.

        A limb's chain ends at a fan of three or more branches (fingers, toes).
        """
        chain = [first]
        while True:
            onward = self._onward(chain[-1])
            if onward is None or (limb and self.is_fan(chain[-1])):
                return chain
            chain.append(onward)

    def _onward(self, joint: int) -> int | None:
        open_ = [child for child in self.children[joint] if not self.skipped[child]]
        return max(open_, key=lambda child: (self.branch_length(child), -child), default=None)

    def is_fan(self, joint: int) -> bool:
        """Whether three or more branches of similar length leave the joint: fingers or toes, not twist helpers."""
        spread = sorted((self.branch_length(c) for c in self.children[joint] if not self.skipped[c]), reverse=True)
        return len(spread) >= 3 and spread[2] > 0.55 * spread[0]
