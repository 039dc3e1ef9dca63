"""Resampling keeps time, ends, and what the lower rate can show; it folds nothing higher back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion
from stages.shared.kinematics.resampling import resample, resampled_frames


def _swing(fps: float, seconds: float, hertz: float, degrees: float = 60.0) -> Motion:
    times = np.arange(int(seconds * fps) + 1) / fps
    angle = np.deg2rad(degrees) * np.sin(2 * np.pi * hertz * times)
    rotations = np.stack([Rotation.from_rotvec(np.outer(angle, axis)).as_quat() for axis in np.eye(3)], axis=1)
    places = np.stack([np.sin(2 * np.pi * hertz * times), times, times**2], axis=1)
    return Motion(
        rotations.astype(np.float32), places.astype(np.float32), fps, np.array([2], np.int32), places[:, None] * 0.1
    )


@pytest.mark.parametrize(
    ("source", "target"), [(120, 30), (60, 30), (90, 30), (50, 30), (24, 30), (29.97, 30), (100, 60)]
)
def test_slow_motion_comes_through_unchanged(source: float, target: float) -> None:
    motion, expected = _swing(source, 4, 0.5), _swing(target, 4, 0.5)
    got = resample(motion, target)
    frames = resampled_frames(motion.frames, source, target)
    assert got.frames == frames <= expected.frames and got.fps == target
    # A low-pass of eight frames' width takes a little off the swing's amplitude near the ends.
    assert np.allclose(got.root_positions, expected.root_positions[:frames], atol=0.01)
    assert np.allclose(got.tracks, expected.tracks[:frames], atol=0.001)
    agree = np.abs((got.rotations * expected.rotations[:frames]).sum(-1))
    assert np.rad2deg(2 * np.arccos(agree.clip(max=1))).max() < 1.0
    assert np.allclose(np.linalg.norm(got.rotations, axis=-1), 1, atol=1e-5)


def test_what_is_too_fast_for_the_lower_rate_is_taken_out_not_folded_back() -> None:
    fast = resample(_swing(120, 4, 32, degrees=5), 30)  # would come back as 2 Hz
    middle = slice(10, -10)
    turned = np.rad2deg(Rotation.from_quat(fast.rotations[middle, 0]).magnitude())
    assert turned.max() < 0.5
    assert np.abs(fast.root_positions[middle, 0]).max() < 0.1


def test_ends_stay_put_and_the_same_rate_is_the_same_motion() -> None:
    motion = _swing(120, 1.0, 0.7)
    got = resample(motion, 30)
    assert np.allclose(got.root_positions[0], motion.root_positions[0], atol=1e-6)
    assert np.allclose(got.root_positions[-1], motion.root_positions[-1], atol=1e-6)
    assert resample(motion, 120) is motion


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_very_short_clips(frames: int) -> None:
    motion = _swing(120, 1, 1)
    short = Motion(motion.rotations[:frames], motion.root_positions[:frames], 120.0)
    for fps in (30, 60, 240):
        got = resample(short, fps)
        assert got.frames == resampled_frames(frames, 120, fps) == len(got.tracks)
        assert np.isfinite(got.rotations).all()


def test_a_rate_that_is_none() -> None:
    with pytest.raises(UsageError):
        resample(_swing(30, 1, 1), 0)
