"""Euler channels of a BVH to quaternions and back, for any order and any number of rotation channels.

A joint's rotation is the product of its channels' rotations in the order of the channels (intrinsic axes), in
degrees.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

_AXIS = {"X": 0, "Y": 1, "Z": 2}
LOCKED = 1e-6  # gimbal lock: below this cosine of the middle angle only a sum of the outer angles is determined


def to_quaternions(angles: np.ndarray, axes: str) -> np.ndarray:
    """Quaternions (..., 4) xyzw of channel angles (..., n) degrees about `axes` ("ZXY", "Y", ...), n of 0 to 3."""
    return np.moveaxis(quaternion_parts(np.moveaxis(angles, -1, 0), axes), 0, -1)


def quaternion_parts(angles: np.ndarray, axes: str, turning: Sequence[bool] | None = None) -> np.ndarray:
    """Components (4, ...) of the quaternions of channel angles (n, ...), so that each step runs on whole arrays.

    turning: n flags, False for a channel whose angles are all zero, which is left out; None to look at the angles.
    """
    parts = np.zeros((4, *angles.shape[1:]))
    parts[3] = 1.0
    flags = [angle.any() for angle in angles] if turning is None else turning
    for angle, axis, turns in zip(angles, axes, flags, strict=True):
        if not turns:
            continue
        half = angle * (np.pi / 360)
        sin, cos = np.sin(half), np.cos(half)
        first, after, last, w = (parts[(_AXIS[axis] + k) % 3] if k < 3 else parts[3] for k in range(4))
        turned = (first * cos + w * sin, after * cos + last * sin, last * cos - after * sin, w * cos - first * sin)
        for k in range(3):
            parts[(_AXIS[axis] + k) % 3] = turned[k]
        parts[3] = turned[3]
    return parts


def angles_near(rotations: np.ndarray, axes: str, near: np.ndarray) -> np.ndarray:
    """Channel angles of rotations: in each frame those nearest to `near` or, where that is NaN, to the frame before.

    Args:
        rotations: (T, 4) quaternions xyzw.
        axes: the joint's rotation channels, 1 to 3 of "XYZ"; rotation about missing axes is lost.
        near: (T, n) degrees; NaN in frames to keep near to the frame before (or, in the first frame, to zero).
    Returns: (T, n) degrees.
    """
    near = near.copy()
    guided = np.asarray(np.isfinite(near).all(axis=1))
    if len(near) and not guided[0]:
        near[0], guided[0] = 0.0, True
    if len(axes) == 1:
        angles = np.rad2deg(2 * np.arctan2(rotations[:, _AXIS[axes]], rotations[:, 3]))[:, None]
        return _unwrapped(angles, near, guided)
    full = axes if len(axes) == 3 else axes + next(axis for axis in "XYZ" if axis not in axes)
    first, locked = _tait_bryan(rotations, full)
    pair = np.stack([first, other_triple(first)])[:, :, : len(axes)]
    if locked.any() and len(axes) == 3:
        return _one_by_one(pair, near, guided, locked, parity_of(axes))
    return _unwrapped(_chosen(pair, near, guided), near, guided)


def other_triple(angles: np.ndarray) -> np.ndarray:
    """The other Euler triple (..., 3) of the same rotation."""
    return np.stack([angles[..., 0] + 180, 180 - angles[..., 1], angles[..., 2] + 180], axis=-1)


def _distance(angles: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Sum over the last axis of (..., n) of the distances between angles and a goal, modulo 360 degrees."""
    apart = goal - angles
    return np.abs(apart - 360.0 * np.round(apart / 360.0)).sum(axis=-1)


def _chosen(pair: np.ndarray, near: np.ndarray, guided: np.ndarray) -> np.ndarray:
    """Of the two triples (2, T, n) of each frame the one nearer to the guide, or to the triple of the frame before.

    A frame changes to the other triple, or does not, whichever triple the frame before has: the distances are the
    same. So the choices between two guided frames are a running sum of changes, and all frames are computed at once.
    """
    by_guide = (_distance(pair[1], near) < _distance(pair[0], near)) & guided
    changes = np.zeros(len(near), np.int64)
    changes[1:] = _distance(pair[1, 1:], pair[0, :-1]) < _distance(pair[0, 1:], pair[0, :-1])
    choice = _since_guided(changes, by_guide.astype(np.int64), guided) % 2
    return np.where(choice[:, None] == 1, pair[1], pair[0])


def _unwrapped(angles: np.ndarray, near: np.ndarray, guided: np.ndarray) -> np.ndarray:
    """Angles (T, n) plus multiples of 360 degrees, each nearest to its guide or to the frame before."""
    steps = np.zeros(angles.shape)
    steps[1:] = np.round((angles[:-1] - angles[1:]) / 360.0)
    by_guide = np.round((np.where(guided[:, None], near, 0.0) - angles) / 360.0)
    return angles + 360.0 * _since_guided(steps, by_guide, guided)


def _since_guided(steps: np.ndarray, starts: np.ndarray, guided: np.ndarray) -> np.ndarray:
    """Running sum of steps (T, ...) that is reset to `starts` in every guided frame; frame 0 must be guided."""
    total = np.cumsum(steps, axis=0)
    last = np.maximum.accumulate(np.where(guided, np.arange(len(guided)), 0))
    return starts[last] + total - total[last]


def _one_by_one(
    pair: np.ndarray, near: np.ndarray, guided: np.ndarray, locked: np.ndarray, parity: float
) -> np.ndarray:
    """The same as `_unwrapped` of `_chosen`, frame by frame, for curves that pass through gimbal lock."""
    out = np.empty(near.shape)
    previous = np.zeros(near.shape[1])
    for frame in range(len(near)):
        guide = near[frame] if guided[frame] else previous
        if locked[frame]:
            previous = nearest_locked(pair[0, frame], guide, parity)
        else:
            both = pair[:, frame] + 360.0 * np.round((guide - pair[:, frame]) / 360.0)
            previous = both[np.abs(both - guide).sum(axis=1).argmin()]
        out[frame] = previous
    return out


def parity_of(axes: str) -> float:
    """1 for a cyclic order of axes (XYZ, YZX, ZXY), -1 for the others."""
    return 1.0 if (_AXIS[axes[1]] - _AXIS[axes[0]]) % 3 == 1 else -1.0


def _tait_bryan(rotations: np.ndarray, axes: str) -> tuple[np.ndarray, np.ndarray]:
    """Angles (T, 3) degrees about three different intrinsic axes, the middle one in [-90, 90]; (T,) gimbal lock."""
    i, j, k = (_AXIS[axis] for axis in axes)
    sign = parity_of(axes)
    matrix = Rotation.from_quat(rotations).as_matrix()
    middle_sin = np.clip(sign * matrix[:, i, k], -1.0, 1.0)
    middle_cos = np.hypot(matrix[:, i, i], matrix[:, i, j])
    middle = np.arctan2(middle_sin, middle_cos)
    locked = np.asarray(middle_cos < LOCKED)
    first = np.arctan2(-sign * matrix[:, j, k], matrix[:, k, k])
    third = np.arctan2(-sign * matrix[:, i, j], matrix[:, i, i])
    first = np.where(locked, np.arctan2(sign * matrix[:, k, j], matrix[:, j, j]), first)
    third = np.where(locked, 0.0, third)
    return np.rad2deg(np.stack([first, middle, third], axis=1)), locked


def nearest_locked(angles: np.ndarray, guide: np.ndarray, parity: float) -> np.ndarray:
    """Angles at gimbal lock: only first + third (or first - third) is determined; both move equally off the guide."""
    turn = parity if angles[1] > 0 else -parity
    wanted = angles[0] + turn * angles[2]
    error = wanted - (guide[0] + turn * guide[2])
    error -= 360.0 * np.round(error / 360.0)
    middle = angles[1] + 360.0 * np.round((guide[1] - angles[1]) / 360.0)
    return np.array([guide[0] + error / 2, middle, guide[2] + turn * error / 2])
