"""Where a clip goes on: heading, path and speed of a body, and moving a whole clip on the ground."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.anatomy import parts_of_skeleton
from stages.shared.humanoid.facing import BodyPoses, bone_tips, find_facing
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.rotations import multiply, turned_about_y

_SPEED_S = 0.1  # time over which a speed at a clip's end is taken


@dataclass(frozen=True)
class Placement:
    """A turn about the vertical through a point, and a shift on the ground.

    yaw_rad: about Y. pivot, shift: (3,) metres.
    """

    yaw_rad: float
    pivot: np.ndarray
    shift: np.ndarray

    def of_motion(self, motion: Motion) -> Motion:
        """The motion turned and shifted; heights stay."""
        half = self.yaw_rad / 2
        turn = np.array([0.0, np.sin(half), 0.0, np.cos(half)])
        rotations = multiply(np.broadcast_to(turn, motion.rotations.shape), motion.rotations.astype(np.float64))
        roots = self.of_places(motion.root_positions.astype(np.float64))
        return replace(motion, rotations=rotations.astype(np.float32), root_positions=roots.astype(np.float32))

    def of_places(self, places: np.ndarray) -> np.ndarray:
        """Places (..., 3) turned and shifted."""
        return (
            turned_about_y(np.asarray(places - self.pivot, np.float64), np.asarray(self.yaw_rad))
            + self.pivot
            + self.shift
        )


def placement_after(skeleton: Skeleton, before: Motion, after: Motion, seconds: float) -> Placement:
    """The placement of `after` that makes it go on where `before` ends, so many seconds later.

    The body's heading and its pelvis' place on the ground go on at the mean of the speeds with which `before` ends
    and `after` begins. Heights are not changed.

    Args:
        before, after: motions of one skeleton and of one rate.
    """
    ends = before.at(slice(-_frames_of_speed(before), None))
    starts = after.at(slice(0, _frames_of_speed(after)))
    headings = [np.unwrap(headings_of_motion(skeleton, part)) for part in (ends, starts)]
    rates = [_slope(heading, before.fps) for heading in headings]
    yaw = float(headings[0][-1] + seconds * np.mean(rates) - headings[1][0])
    pelvis = [positions_of(skeleton, part)[:, skeleton.root] * (1.0, 0.0, 1.0) for part in (ends, starts)]
    speeds = [_slope(place, before.fps) for place in pelvis]
    speed = (speeds[0] + turned_about_y(speeds[1], np.asarray(yaw))) / 2
    pivot = pelvis[1][0]
    return Placement(yaw, pivot, pelvis[0][-1] + seconds * speed - pivot)


def headings_of_motion(skeleton: Skeleton, motion: Motion) -> np.ndarray:
    """(T,) radians about Y by which a body that faces +Z is turned to face as it does, not unwrapped."""
    parts, _, _ = parts_of_skeleton(skeleton)
    heads = positions_of(skeleton, motion)
    known = np.linalg.norm(skeleton.tails, axis=1) > 0
    tips = bone_tips(heads, motion.rotations.astype(np.float64), skeleton.tails, known)
    left = find_facing(BodyPoses(heads, tips), parts).left  # of a body that faces +Z it is +X
    return np.arctan2(-left[:, 2], left[:, 0])


def _frames_of_speed(motion: Motion) -> int:
    return min(max(round(_SPEED_S * motion.fps), 1) + 1, motion.frames)


def _slope(values: np.ndarray, fps: float) -> np.ndarray:
    """Change per second of values (N, ...), the mean over all steps; zeros for one value."""
    if len(values) < 2:
        return np.zeros(values.shape[1:])
    return (values[-1] - values[0]) * (fps / (len(values) - 1))
