"""Euler channels of a BVH to quaternions and back, for joints of any order and any number of rotation channels.

A joint's rotation is the product of its channels' rotations in their order (intrinsic axes), angles in degrees.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

_AXIS = {"X": 0, "Y": 1, "Z": 2}
_LOCKED = 1e-6  # cosine of the middle angle below which only a sum of the outer angles means something


def to_quaternions(angles: np.ndarray, axes: str) -> np.ndarray:
    """Quaternions (..., 4) xyzw of channel angles (..., n) degrees about `axes` ("ZXY", "Y", ...), n of 0 to 3."""
    parts = np.zeros((4, *angles.shape[:-1]))  # components apart: each step then runs over whole arrays
    parts[3] = 1.0
    for i, axis in enumerate(axes):
        half = angles[..., i] * (np.pi / 360)
        sin, cos = np.sin(half), np.cos(half)
        if i == 0:
            parts[_AXIS[axis]], parts[3] = sin, cos
        else:
            parts = _turned_about(parts, _AXIS[axis], sin, cos)
    return np.moveaxis(parts, 0, -1)


def _turned_about(parts: np.ndarray, axis: int, sin: np.ndarray, cos: np.ndarray) -> np.ndarray:
    """Quaternions (4, ...) times a rotation about one of their own axes, cheaper than a whole product."""
    after, last = (axis + 1) % 3, (axis + 2) % 3
    out = np.empty_like(parts)
    out[axis] = parts[axis] * cos + parts[3] * sin
    out[after] = parts[after] * cos + parts[last] * sin
    out[last] = parts[last] * cos - parts[after] * sin
    out[3] = parts[3] * cos - parts[axis] * sin
    return out


def multiply(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Products of quaternions (..., 4) xyzw."""
    x1, y1, z1, w1 = (left[..., i] for i in range(4))
    x2, y2, z2, w2 = (right[..., i] for i in range(4))
    out = np.empty(np.broadcast_shapes(left.shape, right.shape))
    out[..., 0] = w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2
    out[..., 1] = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2
    out[..., 2] = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
    out[..., 3] = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2
    return out


def rotate(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by unit quaternions (..., 4) xyzw."""
    x, y, z, w = (quaternions[..., i] for i in range(4))
    a, b, c = (vectors[..., i] for i in range(3))
    # v + 2 w (q x v) + 2 q x (q x v), written out: np.cross costs more than all of it on small arrays.
    p, q, r = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return np.stack(
        [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p],
        axis=-1,
    )


def angles_near(rotations: np.ndarray, axes: str, near: np.ndarray) -> np.ndarray:
    """Channel angles of rotations, each frame's nearest to given angles or, where those are NaN, to the frame before.

    Args:
        rotations: (T, 4) quaternions xyzw.
        axes: the joint's rotation channels, 1 to 3 of "XYZ"; with fewer than three, what they cannot turn is lost.
        near: (T, n) degrees, rows of NaN where the frame before (or, in the first frame, zero) is the guide.
    Returns: (T, n) degrees.
    """
    if len(axes) == 1:
        candidates = np.rad2deg(2 * np.arctan2(rotations[:, _AXIS[axes]], rotations[:, 3]))[None, :, None]
        locked = np.zeros(len(rotations), bool)
    else:
        full = axes if len(axes) == 3 else axes + next(axis for axis in "XYZ" if axis not in axes)
        first, locked = _tait_bryan(rotations, full)
        second = np.stack([first[:, 0] + 180, 180 - first[:, 1], first[:, 2] + 180], axis=1)
        candidates = np.stack([first, second])[:, :, : len(axes)]
    out = np.empty((len(rotations), len(axes)))
    previous = np.zeros(len(axes))
    guided = np.isfinite(near).all(axis=1)
    for frame in range(len(rotations)):
        guide = near[frame] if guided[frame] else previous
        if locked[frame] and len(axes) == 3:
            previous = _nearest_locked(candidates[0, frame], guide, _parity(axes))
        else:
            choice = candidates[:, frame]
            choice = choice + 360.0 * np.round((guide - choice) / 360.0)
            previous = choice[0] if len(choice) == 1 else choice[np.abs(choice - guide).sum(axis=1).argmin()]
        out[frame] = previous
    return out


def _parity(axes: str) -> float:
    """1 for a cyclic order of axes (XYZ, YZX, ZXY), -1 for the others."""
    return 1.0 if (_AXIS[axes[1]] - _AXIS[axes[0]]) % 3 == 1 else -1.0


def _tait_bryan(rotations: np.ndarray, axes: str) -> tuple[np.ndarray, np.ndarray]:
    """Angles (T, 3) degrees about three different intrinsic axes, middle one in [-90, 90]; and where they lock."""
    i, j, k = (_AXIS[axis] for axis in axes)
    sign = _parity(axes)
    matrix = Rotation.from_quat(rotations).as_matrix()
    middle_sin = np.clip(sign * matrix[:, i, k], -1.0, 1.0)
    middle_cos = np.hypot(matrix[:, i, i], matrix[:, i, j])
    middle = np.arctan2(middle_sin, middle_cos)
    locked = np.asarray(middle_cos < _LOCKED)
    first = np.arctan2(-sign * matrix[:, j, k], matrix[:, k, k])
    third = np.arctan2(-sign * matrix[:, i, j], matrix[:, i, i])
    first = np.where(locked, np.arctan2(sign * matrix[:, k, j], matrix[:, j, j]), first)
    third = np.where(locked, 0.0, third)
    return np.rad2deg(np.stack([first, middle, third], axis=1)), locked


def _nearest_locked(angles: np.ndarray, guide: np.ndarray, parity: float) -> np.ndarray:
    """At the lock only first + third (or first - third) counts: share the way from the guide between the two."""
    turn = parity if angles[1] > 0 else -parity
    wanted = angles[0] + turn * angles[2]
    error = wanted - (guide[0] + turn * guide[2])
    error -= 360.0 * np.round(error / 360.0)
    middle = angles[1] + 360.0 * np.round((guide[1] - angles[1]) / 360.0)
    return np.array([guide[0] + error / 2, middle, guide[2] + turn * error / 2])
