"""Fitting the angles of hinges to any motion.

A motion of freely turning joints (retargeted, filled in) can seldom be reproduced exactly by hinges. Each hinge first
takes the part of its joint's rotation that is about its axis. In frames without a remaining rotation these are the
angles. In all other frames the angles are optimised together, to bring joints near to their places and bones near to
their directions without jumps in time:

    sum over frames of |places - wanted|^2 + |w (directions - wanted)|^2  +  mu sum of |angles(t + 1) - angles(t)|^2

by damped least squares (Levenberg-Marquardt). The equations are banded, since only neighbouring frames are coupled. A
motion far from the hinges' starts at zero angles with a mu so large that the angles hardly change over time; mu is
then reduced, so that all frames use the same one of a shoulder's several solutions for a pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.shared.formats.hinges import Hinges, turned_about
from stages.shared.kinematics.rotations import CONJUGATE, multiply, rotate, shorter_way

LEFT_OVER_RAD = 2e-3  # a smaller rotation about other axes is a rounding error
ROUNDS = 30
_TURN_SHARE, _LEAST_TURN_M = (
    0.3,
    0.005,
)  # w: weight of a radian of a bone's direction, as a share of the bone's length
_LEAF_WEIGHT = 2.0  # weight of a hand's or foot's place; other joints have 1
_SMOOTH_M2 = (1.0, 0.1, 0.01, 1e-3)  # mu, at 30 frames a second: metres squared for a radian squared
_NEAR_RAD = 0.35  # a motion whose joints' own turns leave less over is begun at them, with the last mu
_FIRST_DAMPING = 1e-3
_ENOUGH = 1e-3  # least relative gain of a round after which there is another one
_RUN = 2000  # most frames that are optimised together
_BLOCK = 256  # frames whose derivatives are held at once


@dataclass(frozen=True)
class Fitted:
    """angles: (T, M) radians. off_m: (T,) how far the joint at the end of a limb that is
    farthest from its place is from it.
    fitted: (T,) bool, True in frames in which joints turn about other axes than their hinges.
    held: (T, M) bool, True where an angle is at a limit that it would have passed; all False without limits."""

    angles: np.ndarray
    off_m: np.ndarray
    fitted: np.ndarray
    held: np.ndarray


def fit_hinges(hinges: Hinges, rotations: np.ndarray, fps: float, *, limited: bool = False) -> Fitted:
    """The angles that bring hinges nearest to a motion of free joints.

    Args:
        rotations: (T, J, 4) wanted global rotations, xyzw; joint 0's is used unchanged.
        limited: True to stay within the limits.
    """
    rotations = rotations.astype(np.float64)
    angles, left_over = _own_turns(hinges, rotations)
    angles = _unwound(hinges, angles)
    held = hinges.beyond(angles) & limited
    if limited:
        angles = hinges.within(angles)
    fitted = left_over > LEFT_OVER_RAD
    for first, last in _runs(fitted):
        frames = slice(first, last)
        near = bool(np.median(left_over[frames]) < _NEAR_RAD)
        if not near:
            angles[frames] = hinges.within(np.zeros_like(angles[frames]))
        for smooth in _SMOOTH_M2[-1:] if near else _SMOOTH_M2:
            run = _Run(hinges, rotations, angles, frames, limited, smooth * (fps / 30) ** 2)
            angles[frames] = run.solved()
        held[frames] = run.held()
    off = np.zeros(len(angles))
    for start in range(0, len(angles), _BLOCK):
        some = slice(start, start + _BLOCK)
        made, _ = hinges.poses(rotations[some, 0], angles[some])
        off[some] = np.linalg.norm(made - hinges.heads(rotations[some]), axis=-1)[:, hinges.leaves].max(axis=1)
    return Fitted(angles, off, fitted, held)


def _runs(fitted: np.ndarray) -> list[tuple[int, int]]:
    """Ranges (first, one after the last) of frames to fit, none longer than can be optimised together."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], fitted, [False]]).astype(int)))
    runs = []
    for first, last in edges.reshape(-1, 2).tolist():
        runs += [(start, min(start + _RUN, last)) for start in range(first, last, _RUN)]
    return runs


def _own_turns(hinges: Hinges, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, M) the part of every joint's turn about its own axis, from the pose that the hinges above it reach; and
    (T,) the largest turn that is left over."""
    frames = len(rotations)
    angles = np.zeros((frames, len(hinges.limits)))
    left_over = np.zeros(frames)
    made = np.empty_like(rotations)
    made[:, 0] = rotations[:, 0]
    for joint in range(1, rotations.shape[1]):
        above = multiply(made[:, hinges.parents[joint]], hinges.at_zero[joint])
        left = multiply(above * CONJUGATE, rotations[:, joint])
        column, axis = hinges.columns[joint], hinges.axes[joint]
        if column < 0:
            turn = np.zeros(frames)
        elif hinges.leads[joint]:
            turn = 2 * np.arctan2(left[:, :3] @ axis, left[:, 3])
            turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
            angles[:, column] = turn
        else:
            turn = angles[:, column] * hinges.factors[joint] + hinges.shifts[joint]
        done = turned_about(axis, turn)
        made[:, joint] = multiply(above, done)
        rest = multiply(done * CONJUGATE, left)
        if column >= 0:
            swing = 2 * np.arctan2(np.linalg.norm(rest[:, :3], axis=1), np.abs(rest[:, 3]))
            left_over = np.maximum(left_over, swing)
    return angles, left_over


def _unwound(hinges: Hinges, angles: np.ndarray) -> np.ndarray:
    """Angles with limits, shifted by whole turns to the range around their middle; others without jumps in time."""
    bounded = np.isfinite(hinges.limits).all(axis=1)
    middle = hinges.limits[bounded].mean(axis=1)
    out = np.unwrap(angles, axis=0)
    out -= 2 * np.pi * np.round(np.median(out, axis=0) / (2 * np.pi))
    out[:, bounded] = angles[:, bounded] - 2 * np.pi * np.round((angles[:, bounded] - middle) / (2 * np.pi))
    return out


class _Run:
    """Consecutive frames to fit; the frames before and after them are fixed.

    Args:
        angles: (T, M) initial angles of the whole motion. frames: the frames to fit.
    """

    def __init__(
        self,
        hinges: Hinges,
        rotations: np.ndarray,
        angles: np.ndarray,
        frames: slice,
        limited: bool,
        smooth: float,
    ) -> None:
        self.hinges, self.smooth = hinges, smooth
        self.rotations = rotations[frames]
        self.wanted = hinges.heads(self.rotations)
        self.angles = angles[frames].copy()
        self.before = angles[frames.start - 1] if frames.start > 0 else None
        self.after = angles[frames.stop] if frames.stop < len(angles) else None
        free = np.full((len(hinges.limits), 2), (-np.inf, np.inf))
        self.low, self.high = (hinges.limits if limited else free).T
        self.place_weights = np.where(hinges.leaves, _LEAF_WEIGHT, 1.0)
        self.weights = np.maximum(hinges.lengths * _TURN_SHARE, _LEAST_TURN_M)

    def solved(self) -> np.ndarray:
        """(F, M) the angles after all rounds."""
        damping = _FIRST_DAMPING
        cost = self._cost(self.angles)
        square, slope = self._equations()
        for _ in range(ROUNDS):
            step = self._step(square, slope, damping)
            tried = np.clip(self.angles + np.clip(step, -0.5, 0.5), self.low, self.high)
            new_cost = self._cost(tried)
            if not new_cost < cost:
                damping *= 10
                if damping > 1e6:
                    break
                continue
            gain = cost - new_cost
            self.angles, cost, damping = tried, new_cost, max(damping * 0.2, 1e-9)
            if gain < _ENOUGH * cost + 1e-12:
                break
            square, slope = self._equations()
        return self.angles

    def held(self) -> np.ndarray:
        """(F, M) True where an angle is at its limit and the optimum is beyond it."""
        _, slope = self._equations()
        return self._stuck(slope)

    def _stuck(self, slope: np.ndarray) -> np.ndarray:
        return ((self.angles <= self.low) & (slope < 0)) | ((self.angles >= self.high) & (slope > 0))

    def _cost(self, angles: np.ndarray) -> float:
        total = self.smooth * float((self._changes(angles) ** 2).sum())
        for start in range(0, len(angles), _BLOCK):
            errors, *_ = self._errors(angles, slice(start, start + _BLOCK))
            total += float((errors * errors).sum())
        return total

    def _changes(self, angles: np.ndarray) -> np.ndarray:
        """Differences of neighbouring frames, including the fixed ones."""
        beside = [row[None] for row in (self.before,) if row is not None]
        after = [row[None] for row in (self.after,) if row is not None]
        return np.diff(np.concatenate([*beside, angles, *after]), axis=0)

    def _equations(self) -> tuple[np.ndarray, np.ndarray]:
        """J^T J (F, M, M) of the poses' errors, and the negative gradient (F, M) of the whole cost."""
        frames, count = self.angles.shape
        square = np.empty((frames, count, count))
        slope = np.empty((frames, count))
        for start in range(0, frames, _BLOCK):
            some = slice(start, start + _BLOCK)
            errors, heads, made = self._errors(self.angles, some)
            jacobian = self._jacobian(heads, made)
            square[some] = jacobian @ jacobian.transpose(0, 2, 1)
            slope[some] = (jacobian @ errors[..., None])[..., 0]
        changes = self._changes(self.angles)
        onward = changes[len(changes) - frames :] if self.before is not None else changes[:frames]
        if self.before is not None:
            slope -= self.smooth * changes[:frames]
            slope[: len(changes) - 1] += self.smooth * changes[1:]
        else:
            slope[: len(onward)] += self.smooth * onward
            slope[1:] -= self.smooth * changes[: frames - 1]
        return square, slope

    def _step(self, square: np.ndarray, slope: np.ndarray, damping: float) -> np.ndarray:
        """(F, M) the step of damped least squares; angles held at a limit do not change."""
        frames, count = self.angles.shape
        free = ~self._stuck(slope)
        square = square * free[:, :, None] * free[:, None, :]
        neighbours = np.full(frames, 2.0)
        neighbours[0] -= self.before is None
        neighbours[-1] -= self.after is None
        diagonal = np.arange(count)
        square[:, diagonal, diagonal] += damping * 1e-2 + 1e-9 + self.smooth * neighbours[:, None]
        return _solved_in_line(square, self.smooth * (free[1:] & free[:-1]), slope * free)

    def _errors(self, angles: np.ndarray, some: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Errors (F, 6 J) of heads' places and of weighted directions, in metres; heads; rotations."""
        heads, made = self.hinges.poses(self.rotations[some, 0], angles[some])
        apart = multiply(self.rotations[some], made * CONJUGATE)
        directions = 2 * shorter_way(apart)[..., :3] * self.weights[:, None]
        missing = (self.wanted[some] - heads) * self.place_weights[:, None]
        errors = np.concatenate([missing, directions], axis=-1)
        return errors.reshape(len(heads), -1), heads, made

    def _jacobian(self, heads: np.ndarray, made: np.ndarray) -> np.ndarray:
        """(F, M, 6 J) negative derivative of each error by each angle."""
        hinges = self.hinges
        frames, joints = heads.shape[:2]
        axes = rotate(made, hinges.axes) * hinges.factors[:, None]
        out = np.zeros((frames, len(hinges.limits), joints, 6))
        for joint in np.flatnonzero(hinges.columns >= 0):
            below = np.flatnonzero(hinges.reaches[joint])
            axis, column = axes[:, joint, None], hinges.columns[joint]
            moved = _crossed(axis, heads[:, below] - heads[:, joint, None])
            out[:, column, below, :3] += moved * self.place_weights[below, None]
            out[:, column, below, 3:] += axis * self.weights[below, None]
        return out.reshape(frames, len(hinges.limits), -1)


def _solved_in_line(square: np.ndarray, tied: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """x (F, M) with square[f] x[f] - tied[f - 1] x[f - 1] - tied[f] x[f + 1] = wanted[f], by block elimination.

    Args:
        square: (F, M, M) positive definite. tied: (F - 1, M), of each frame and the next. wanted: (F, M).
    """
    # SciPy's banded solver is several times slower when its threads wait for cores that other programs use.
    frames = len(square)
    inverse = np.empty_like(square)
    partial = wanted.copy()
    inverse[0] = np.linalg.inv(square[0])
    for frame in range(1, frames):
        tie = tied[frame - 1]
        inverse[frame] = np.linalg.inv(square[frame] - tie[:, None] * inverse[frame - 1] * tie)
        partial[frame] += tie * (inverse[frame - 1] @ partial[frame - 1])
    out = np.empty_like(wanted)
    out[-1] = inverse[-1] @ partial[-1]
    for frame in range(frames - 2, -1, -1):
        out[frame] = inverse[frame] @ (partial[frame] + tied[frame] * out[frame + 1])
    return out


def _crossed(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    a, b, c = (left[..., i] for i in range(3))
    x, y, z = (right[..., i] for i in range(3))
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)
