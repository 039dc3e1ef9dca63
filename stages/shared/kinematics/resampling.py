"""Changing a motion's rate: a low-pass when going down, then cubic positions and slerped rotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion
from stages.shared.kinematics.rotations import slerp

_LOBES = 4  # half width of the low-pass, in frames of the lower rate


def resampled_frames(frames: int, fps: float, target_fps: float) -> int:
    """Number of frames of the target rate between a clip's first and last moment."""
    return int(np.floor((frames - 1) * target_fps / fps + 1e-6)) + 1


def resample(motion: Motion, fps: float) -> Motion:
    """The motion at another rate, over the same time, its first frame at the same moment.

    Args:
        fps: target rate, frames per second.
    Returns: a motion of `resampled_frames` frames; the same arrays if the rate is the motion's own.
    Raises: UsageError if the rate is not positive.
    """
    if not fps > 0:
        raise UsageError(f"A rate of {fps} frames a second is none.")
    if motion.fps == fps:
        return motion
    times = np.arange(resampled_frames(motion.frames, motion.fps, fps)) * (motion.fps / fps)
    times = np.minimum(times, motion.frames - 1)
    if motion.frames == 1:
        return replace(motion, fps=fps, tracks=motion.tracks.reshape(1, len(motion.track_joints), 3))
    kernel = _low_pass(motion.fps / fps)
    rotations = _filtered(motion.rotations, kernel)
    if len(kernel) > 1:
        rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    tracked = len(motion.track_joints) > 0
    return Motion(
        rotations=_slerp_at(rotations, times),
        root_positions=_cubic_at(_filtered(motion.root_positions, kernel), times),
        fps=fps,
        track_joints=motion.track_joints,
        tracks=_cubic_at(_filtered(motion.tracks, kernel), times)
        if tracked
        else np.zeros((len(times), 0, 3), np.float32),
    )


def _low_pass(ratio: float) -> np.ndarray:
    """Windowed-sinc kernel that keeps the frequencies of a rate `ratio` times lower; [1] for a higher rate."""
    if ratio <= 1.0 + 1e-9:
        return np.ones(1)
    half = int(np.ceil(_LOBES * ratio))
    steps = np.arange(-half, half + 1)
    kernel = np.sinc(steps / ratio) * np.hamming(2 * half + 1)
    return kernel / kernel.sum()


def _filtered(values: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Values (T, ...) low-passed along time; beyond the ends the curve is mirrored at the end point, so the ends do
    not move."""
    if len(kernel) == 1 or values.size == 0:
        return values
    half = min(len(kernel) // 2, len(values) - 1)
    before = 2 * values[:1] - values[1 : half + 1][::-1]
    after = 2 * values[-1:] - values[-half - 1 : -1][::-1]
    padded = np.concatenate([before, values, after])
    return convolve1d(padded, kernel, axis=0, mode="nearest")[half : half + len(values)]


def _cubic_at(values: np.ndarray, times: np.ndarray) -> np.ndarray:
    whole = np.round(times)
    if np.abs(times - whole).max() < 1e-6:
        return values[whole.astype(np.int64)]
    spline = CubicSpline(np.arange(len(values)), values.astype(np.float64), axis=0)
    return spline(times).astype(np.float32)


def _slerp_at(rotations: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Quaternions (T, J, 4), sign-continuous, at real-valued frames (N,)."""
    whole = np.round(times)
    if np.abs(times - whole).max() < 1e-6:
        return rotations[whole.astype(np.int64)]
    below = np.minimum(times.astype(np.int64), len(rotations) - 2)
    share = (times - below).astype(np.float32)[:, None, None]
    mixed = slerp(rotations[below], rotations[below + 1], share)
    return (mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)).astype(np.float32)
