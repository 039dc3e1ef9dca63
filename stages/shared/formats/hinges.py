"""Joints that turn about one axis each, such as a robot's: from angles to poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stages.shared.kinematics.forward_numpy import global_rotations, joint_positions
from stages.shared.kinematics.rotations import multiply


@dataclass(frozen=True)
class Hinges:
    """A tree of J joints with M angles; lengths in metres, angles in radians, quaternions xyzw.

    parents:   (J,) int, parents before children, -1 for joint 0, which is placed and turned freely.
    offsets:   (J, 3) heads in the parents' frames.
    at_zero:   (J, 4) a joint's rotation in its parent's frame at angle zero.
    axes:      (J, 3) of length 1 in the joint's own frame, zeros if it does not turn.
    columns:   (J,) int, index of its angle, -1 for none: it turns by factors * angle + shifts.
    leads:     (J,) bool, True for the joint that owns its angle; other joints with the same angle mimic it.
    limits:    (M, 2) lowest and highest angle, infinite if there is no limit.
    """

    parents: np.ndarray
    offsets: np.ndarray
    at_zero: np.ndarray
    axes: np.ndarray
    columns: np.ndarray
    leads: np.ndarray
    factors: np.ndarray
    shifts: np.ndarray
    limits: np.ndarray

    @cached_property
    def leaves(self) -> np.ndarray:
        """(J,) bool, True for joints without children: hands, feet, head."""
        return ~np.isin(np.arange(len(self.parents)), self.parents)

    @cached_property
    def lengths(self) -> np.ndarray:
        """(J,) metres from each joint to the farthest joint below it; 0.1 for leaves."""
        out = np.zeros(len(self.parents))
        np.maximum.at(out, self.parents[1:], np.linalg.norm(self.offsets[1:], axis=1))
        out[self.leaves] = 0.1
        return out

    @cached_property
    def reaches(self) -> np.ndarray:
        """(J, J) bool, [i, k] True if joint k is i or below it."""
        out = np.eye(len(self.parents), dtype=bool)
        for joint, parent in enumerate(self.parents.tolist()):
            if parent >= 0:
                out[:, joint] |= out[:, parent]
        return out

    def turns(self, angles: np.ndarray) -> np.ndarray:
        """(T, J) by how much every joint turns, of angles (T, M)."""
        moved = self.columns >= 0
        out = np.zeros((len(angles), len(self.parents)))
        out[:, moved] = angles[:, self.columns[moved]] * self.factors[moved] + self.shifts[moved]
        return out

    def local_rotations(self, angles: np.ndarray) -> np.ndarray:
        """(T, J, 4) rotations in the parents' frames, of angles (T, M); joint 0's is the identity."""
        return multiply(self.at_zero, turned_about(self.axes, self.turns(angles)))

    def poses(self, root: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Heads (T, J, 3) beside joint 0 and global rotations (T, J, 4), of joint 0's rotations (T, 4) and angles."""
        local = self.local_rotations(angles)
        local[:, 0] = root
        made = global_rotations(local, self.parents)
        return self.heads(made), made

    def heads(self, rotations: np.ndarray) -> np.ndarray:
        """(T, J, 3) places beside joint 0's, of global rotations (T, J, 4)."""
        return joint_positions(rotations, np.zeros(3), self.offsets, self.parents)

    def beyond(self, angles: np.ndarray, slack_rad: float = 1e-5) -> np.ndarray:
        """(T, M) bool, True where an angle lies outside of its limits."""
        return (angles < self.limits[:, 0] - slack_rad) | (angles > self.limits[:, 1] + slack_rad)

    def within(self, angles: np.ndarray) -> np.ndarray:
        """(T, M) the angles, each no further than its limits."""
        return np.clip(angles, self.limits[:, 0], self.limits[:, 1])


def turned_about(axes: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of turns (...) in radians about axes (..., 3) of length 1."""
    half = turns[..., None] / 2
    return np.concatenate([np.sin(half) * axes, np.cos(half)], axis=-1)
