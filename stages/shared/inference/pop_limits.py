"""The most that a filled motion turns and accelerates: what a clean-up of it must not exceed.

The two measures are those of `stages.shared.statistics.feel_pops`: how far a joint turns between two neighbouring
frames, and the second difference of a joint's positions; of the measured joint that does so most. A clean-up may not
take a larger step than the largest that the filled motion takes within `NEAR_S`. So it never raises the largest step
of a clip, and where a part of a clip takes larger steps than before, one as large was there within that time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from stages.shared.kinematics.frame_blocks import blocks_of
from stages.shared.kinematics.rotations import angles_between
from stages.shared.kinematics.runs import runs_of
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.statistics.measurements import measured_joints

NEAR_S = 2.0  # half of the windows that are measured
ROUNDING = 2e-6  # radians and metres: what float32 poses leave of a difference


class Steps(NamedTuple):
    """How far a joint turns in every pair of frames (T - 1,), radians, and the length of its second difference in
    every three (T - 2,), metres; of the joint that does so most."""

    turns: np.ndarray
    bends: np.ndarray

    @classmethod
    def of(cls, rotations: np.ndarray, positions: np.ndarray) -> Steps:
        """Of global rotations (T, J, 4) and positions (T, K, 3), computed in float64."""
        bends = np.diff(positions.astype(np.float64), n=2, axis=0)
        angles = angles_between(rotations[1:], rotations[:-1])
        return cls(angles.max(-1, initial=0.0), np.linalg.norm(bends, axis=-1).max(-1, initial=0.0))

    @classmethod
    def of_pose(cls, pose: SkeletonPose) -> Steps:
        """Of the measured joints of a pose."""
        joints, rotations, heads = measured_joints(pose.skeleton), pose.rotations, pose.heads
        turns, bends = [], []
        for rows in blocks_of(len(pose)):
            with_next = slice(rows.start, rows.stop + 2)  # the last bend of a block takes two frames of the next
            own = cls.of(rotations[with_next, joints].numpy(force=True), heads[with_next, joints].numpy(force=True))
            turns.append(own.turns[: rows.stop - rows.start])
            bends.append(own.bends)
        return cls(np.concatenate(turns), np.concatenate(bends))


@dataclass(frozen=True)
class PopLimits:
    """The largest steps that a motion takes near each of its steps: of those with a missing frame, within `NEAR_S`.

    turns: (T - 1,) radians. bends: (T - 2,) metres.
    """

    turns: np.ndarray
    bends: np.ndarray

    @classmethod
    def of(cls, steps: Steps, known: np.ndarray, fps: float) -> PopLimits:
        """The limits that a motion sets."""
        near = 2 * round(NEAR_S * fps) + 1
        filled = [np.where(missing, part, 0.0) for missing, part in zip(_missing(known), steps, strict=True)]
        return cls(*(maximum_filter1d(part, near, mode="constant") if len(part) else part for part in filled))

    def rows(self, rows: slice) -> PopLimits:
        """The limits of some of the frames."""
        return PopLimits(self.turns[rows.start : rows.stop - 1], self.bends[rows.start : max(rows.stop - 2, 0)])

    def raised_to(self, steps: Steps) -> PopLimits:
        """Limits that allow at least these steps."""
        return PopLimits(np.maximum(self.turns, steps.turns), np.maximum(self.bends, steps.bends))

    def broken_frames(self, steps: Steps, known: np.ndarray, rounding: float = ROUNDING) -> np.ndarray:
        """Frames of the steps with a missing frame that exceed the limits by more than rounding."""
        missing = _missing(known)
        over = np.zeros(len(known), bool)
        turns = np.flatnonzero((steps.turns > self.turns + rounding) & missing[0])
        bends = np.flatnonzero((steps.bends > self.bends + rounding) & missing[1])
        for frames in (turns, turns + 1, bends, bends + 1, bends + 2):
            over[frames] = True
        return np.flatnonzero(over)


def _missing(known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T - 1,) and (T - 2,) bool: pairs and threes of frames of which one is not known."""
    return ~(known[1:] & known[:-1]), ~(known[2:] & known[1:-1] & known[:-2])


def without_pops(pose: SkeletonPose, changed: SkeletonPose, known: np.ndarray, fps: float) -> SkeletonPose:
    """The changed pose, with the first pose's frames in every gap in which it would exceed the first pose's limits.

    Args:
        pose: T frames. changed: the same with some frames changed that are not known; of the same offsets and roots.
    """
    limits, gaps = PopLimits.of(Steps.of_pose(pose), known, fps), runs_of(~known)
    left = np.ones(len(gaps), bool)  # gaps that are still changed
    while len(over := limits.broken_frames(Steps.of_pose(changed), known)):
        # Three frames around a key belong to the gaps on both sides.
        broken = left & np.array([((over >= gap[0] - 1) & (over <= gap[-1] + 1)).any() for gap in gaps])
        left &= ~broken
        rows = np.concatenate([gap for gap, is_broken in zip(gaps, broken, strict=True) if is_broken])
        changed = changed.with_rows(rows, pose.rows(rows))
    return changed
