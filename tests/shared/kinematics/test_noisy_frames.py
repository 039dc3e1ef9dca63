"""Noisy frames are found in the motion alone; slow references of its two predictions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.noisy_frames import errors_from_clean, noisy_frames, noisy_joints, pair_errors
from stages.shared.kinematics.rotations import continuous_signs, multiply
from tests.shared.inference.examples import humanoid, swinging

SKELETON = humanoid()


def clean(frames: int = 128, seed: int = 0) -> np.ndarray:
    return local_rotations_of(SKELETON, swinging(SKELETON, frames, seed=seed))


def noisy(share: float, size: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    turns, bad = clean(seed=seed), rng.random(128) < share
    moved = turns + size * rng.standard_normal(turns.shape) * bad[:, None, None]
    return continuous_signs(moved / np.linalg.norm(moved, axis=-1, keepdims=True)), bad


@pytest.mark.parametrize("share", [0.2, 0.5, 0.75])
@pytest.mark.parametrize("size", [0.08, 0.2])
def test_noise_on_most_joints_is_found(share: float, size: float):
    turns, bad = noisy(share, size)
    found = noisy_frames(turns)
    assert (found & bad).sum() >= 0.9 * bad.sum()
    # Among many noisy frames, a clean one far from the others is taken for noisy, and mended from them.
    assert (found & ~bad).sum() <= (0.15 if share < 0.7 else 0.35) * (~bad).sum()


@pytest.mark.parametrize("seed", range(4))
def test_hardly_a_frame_of_a_clean_motion_is_noisy(seed: int):
    turns = clean(seed=seed)
    assert noisy_frames(turns).mean() < 0.03
    assert noisy_joints(turns, np.ones(128, bool)).mean() < 0.01


def test_a_joint_alone_is_found():
    turns = clean()
    bad = np.zeros(turns.shape[:2], bool)
    bad[[30, 31, 60, 61, 62, 90], 4] = True
    jolts = Rotation.from_rotvec([[0.6, 0.0, -0.5]]).as_quat()
    turns = np.where(bad[..., None] & (np.arange(128) % 2 == 0)[:, None, None], multiply(turns, jolts), turns)
    found = noisy_joints(continuous_signs(turns), np.ones(128, bool))
    assert found[[30, 60, 62, 90], 4].all() and found.sum() <= 8


def test_a_constant_turn_of_each_joint_means_nothing():
    turns, _ = noisy(0.4, 0.1)
    offset = Rotation.from_rotvec(np.random.default_rng(1).standard_normal((turns.shape[1], 3))).as_quat()
    moved = continuous_signs(multiply(np.broadcast_to(offset, turns.shape), turns))
    assert (noisy_frames(moved) == noisy_frames(turns)).all()


def test_pairs_are_those_of_plain_loops():
    values = np.random.default_rng(0).standard_normal((14, 3, 2))
    expected = np.full(14, np.inf)
    for t in range(14):
        for a in range(max(0, t - 4), min(14, t + 5)):
            for b in range(a + 1, min(14, t + 5)):
                if t in (a, b):
                    continue
                share = (b - t) / (b - a)
                gain = share**2 + (1 - share) ** 2
                if gain <= 6:
                    square = ((values[t] - share * values[a] - (1 - share) * values[b]) ** 2).sum(-1)
                    expected[t] = min(expected[t], np.median(square) / (1 + gain))
    np.testing.assert_allclose(pair_errors(values, together=True, reach=4), expected)


def test_lines_through_clean_frames_are_those_of_plain_loops():
    rng = np.random.default_rng(3)
    values, good = rng.standard_normal((30, 4, 2)), rng.random(30) < 0.5
    error, _ = errors_from_clean(values, good)
    for t in range(30):
        before = [a for a in range(t - 1, -1, -1) if good[a]][:2]
        after = [a for a in range(t + 1, 30) if good[a]][:2]
        lines = [(before[0], after[0])] if before and after else []
        lines += [
            (pair[0], pair[1])
            for pair in (before, after)
            if len(pair) == 2 and (abs(pair[1] - t) <= 3 or not (before and after))
        ]
        found = []
        for a, b in lines:
            share = (b - t) / (b - a)
            found.append(np.sqrt(np.median(((values[t] - share * values[a] - (1 - share) * values[b]) ** 2).sum(-1))))
        assert error[t] == pytest.approx(min(found))


@pytest.mark.parametrize("frames", [1, 2, 4, 6])
def test_short_clips_are_no_error(frames: int):
    turns = clean(128)[:frames]
    assert noisy_frames(turns).shape == (frames,)
    assert noisy_joints(turns, np.ones(frames, bool)).shape == turns.shape[:2]


def test_noise_on_the_positions_of_some_frames_is_found():
    rng = np.random.default_rng(2)
    bad = rng.random(128) < 0.3
    path = np.outer(np.arange(128) / 30, [0.0, 0.0, 1.2]) + 0.03 * np.sin(np.arange(128)[:, None] / 5)
    found = noisy_frames(clean(), path + 0.08 * rng.standard_normal((128, 3)) * bad[:, None])
    assert (found & bad).sum() >= 0.85 * bad.sum() and (found & ~bad).sum() <= 0.15 * (~bad).sum()
    assert noisy_frames(clean(), path).mean() < 0.03


def test_a_strike_of_three_frames_is_a_movement():
    turns = clean(48)
    angle = np.interp(np.arange(48), [0, 20, 21, 22, 23, 47], [0.0, 0.0, 0.4, 1.0, 1.3, 1.3])
    strikes = Rotation.from_rotvec(angle[:, None] * [0.8, 0.3, -0.5]).as_quat()[:, None]
    assert not noisy_frames(continuous_signs(multiply(np.broadcast_to(strikes, turns.shape), turns))).any()
