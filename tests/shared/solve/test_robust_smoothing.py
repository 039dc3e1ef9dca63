"""Mending: noise and gaps go, what is clean stays, frozen and lost joints are told from still ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.rotations import from_turn_vectors, multiply
from stages.shared.pose_tasks.noise import NOISES
from stages.shared.solve.robust_smoothing import frozen_joints, lost_joints, mend_poses
from tests.shared.inference.examples import humanoid, swinging

SKELETON = humanoid()
MOTION = swinging(SKELETON, 128)
LOCAL = local_rotations_of(SKELETON, MOTION)
ROOTS = MOTION.root_positions.astype(float)


def degrees(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.degrees(2 * np.arccos(np.clip(np.abs((one * other).sum(-1)), 0, 1)))


@pytest.mark.parametrize("noise", ["paper", "capture"])
@pytest.mark.parametrize("seed", range(3))
def test_noise_goes(noise: str, seed: int):
    roots, local, _ = NOISES[noise](ROOTS, LOCAL, np.random.default_rng(seed))
    made = mend_poses(local, roots)
    before, after = degrees(local, LOCAL).mean(), degrees(made.local, LOCAL).mean()
    assert after < (0.3 if noise == "paper" else 0.9) * before
    assert np.isfinite(made.positions).all() and np.allclose(np.linalg.norm(made.local, axis=-1), 1)


def test_a_clean_motion_stays():
    made = mend_poses(LOCAL, ROOTS)
    assert degrees(made.local, LOCAL).mean() < 0.2 and np.abs(made.positions - ROOTS).mean() < 0.001


def test_missing_values_are_not_read_and_are_filled():
    missing = np.zeros(LOCAL.shape[:2], bool)
    missing[40:48, 3] = True
    missing[70:74] = True
    made = [
        mend_poses(
            np.where(missing[..., None], junk, LOCAL),
            np.where(missing.all(1)[:, None], junk, ROOTS),
            missing,
        )
        for junk in (0.0, 0.7, np.nan)
    ]
    for other in made[1:]:
        np.testing.assert_array_equal(other.local, made[0].local)
        np.testing.assert_array_equal(other.positions, made[0].positions)
    assert degrees(made[0].local, LOCAL)[missing].max() < 4
    assert made[0].frames[70:74].all() and made[0].noisy[40:48, 3].all()


def test_a_joint_that_is_lost_or_frozen_is_found_and_one_that_is_held_is_not():
    local = LOCAL.copy()
    local[20:30, 4] = [0, 0, 0, 1]
    assert lost_joints(local)[20:30, 4].all() and lost_joints(local).sum() == 10
    to_the_end = LOCAL.copy()
    to_the_end[100:, 4] = [0, 0, 0, 1]
    assert not lost_joints(to_the_end).any()  # a pose that is held
    frozen = LOCAL.copy()
    frozen[50:70, 6] = frozen[50, 6]
    found = frozen_joints(frozen)
    assert found[52:69, 6].all() and not found[:, :6].any()
    held = LOCAL.copy()
    held[:100, 6] = held[0, 6]
    assert not frozen_joints(held).any()


def test_noise_is_the_papers():
    """On 20 to 80 % of the frames, and of no more than the paper's size; other frames keep their numbers."""
    for seed in range(20):
        roots, local, noisy = NOISES["paper"](ROOTS, LOCAL, np.random.default_rng(seed))
        frames = noisy[:, 0]
        assert 0.19 < frames.mean() < 0.81 and (noisy == frames[:, None]).all()
        assert (roots[~frames] == ROOTS[~frames]).all() and (local[~frames] == LOCAL[~frames]).all()
        assert 0 < (roots - ROOTS)[frames].std() < 0.12 and np.abs(local - LOCAL)[frames].mean() < 0.2


def _clip(name: str) -> tuple[np.ndarray, np.ndarray]:
    path = Path(f"stages/shared/clips/{name}.bvh")
    skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), path.name))
    return local_rotations_of(skeleton, motion).astype(float), motion.root_positions.astype(float)


@pytest.mark.parametrize("name", ["kick", "punch", "spinkick", "jump"])
def test_a_quick_movement_is_no_noise_and_a_burst_is(name: str):
    local, roots = _clip(name)
    assert degrees(mend_poses(local, roots).local, local).mean() < 0.4
    struck, at = local.copy(), slice(20, 26)
    struck[at, 4] = multiply(struck[at, 4], from_turn_vectors(0.4 * np.random.default_rng(0).standard_normal((6, 3))))
    assert mend_poses(struck, roots).noisy[at, 4].sum() >= 4


def test_jitter_of_all_frames_goes():
    local, roots = _clip("walk")
    turns = np.radians(0.8) * np.random.default_rng(0).standard_normal((*local.shape[:2], 3))
    shaken = multiply(local, from_turn_vectors(turns))
    assert degrees(mend_poses(shaken, roots).local, local).mean() < 0.8 * degrees(shaken, local).mean()
