"""Exchanged limbs are found at their seams and put back; what only looks like it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.symmetric_pairs import pairs_of_limbs
from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.swapped_sides import exchanged, exchanged_frames
from stages.shared.pose_tasks.noise import paper_noise
from stages.shared.solve.robust_smoothing import mend_poses

CLIPS = sorted(Path("stages/shared/clips").glob("*.bvh"))
ARMS, LEGS = range(2)


def clip(path: Path) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), path.name))
    limbs = pairs_of_limbs(skeleton.names, skeleton.parents, skeleton.offsets, skeleton.groups)
    local = local_rotations_of(skeleton, motion).astype(float)
    return local / np.linalg.norm(local, axis=-1, keepdims=True), motion.root_positions.astype(float), limbs


LOCAL, ROOTS, LIMBS = clip(Path("stages/shared/clips/walk.bvh"))


def stretch(start: int, stop: int) -> np.ndarray:
    return (np.arange(len(LOCAL)) >= start) & (np.arange(len(LOCAL)) < stop)


@pytest.mark.parametrize("path", CLIPS, ids=lambda path: path.stem)
def test_clean_clips_have_none(path: Path):
    local, _, limbs = clip(path)
    assert not any(exchanged_frames(local, limb).any() for limb in limbs)


@pytest.mark.parametrize("which", [ARMS, LEGS])
@pytest.mark.parametrize(("start", "stop"), [(30, 55), (40, 45), (0, 40), (100, 152)])
def test_a_stretch_is_found_exactly_whatever_the_quaternions_signs_are(which: int, start: int, stop: int):
    at = stretch(start, stop)
    signs = np.random.default_rng(start).choice([-1.0, 1.0], LOCAL.shape[:2])
    swapped = exchanged(LOCAL, at, LIMBS[which]) * signs[..., None]
    np.testing.assert_array_equal(exchanged_frames(swapped, LIMBS[which]), at)
    assert not exchanged_frames(swapped, LIMBS[1 - which]).any()


def test_two_stretches_of_both_limbs_are_put_back_as_they_were():
    local = LOCAL
    for limb, at in ((LIMBS[ARMS], stretch(20, 50)), (LIMBS[LEGS], stretch(35, 60)), (LIMBS[ARMS], stretch(90, 99))):
        local = exchanged(local, at, limb)
    plain, made = mend_poses(LOCAL, ROOTS, limbs=LIMBS), mend_poses(local, ROOTS, limbs=LIMBS)
    np.testing.assert_array_equal(made.local, plain.local)
    assert not plain.swapped.any() and made.swapped[20:50, LIMBS[ARMS]].all() and made.swapped[:, 0].sum() == 0
    assert not mend_poses(local, ROOTS).swapped.any()


def test_a_joint_that_is_missing_within_is_exchanged_as_missing():
    at, missing = stretch(30, 60), np.zeros(LOCAL.shape[:2], bool)
    left, right = LIMBS[ARMS][0]
    missing[40:44, left] = True  # of a swapped file: what is missing is the right joint's rotation
    local = np.where(missing[..., None], np.nan, exchanged(LOCAL, at, LIMBS[ARMS]))
    made = mend_poses(local, ROOTS, missing, LIMBS)
    assert made.swapped[30:60, left].all() and np.isfinite(made.local).all()
    np.testing.assert_allclose(made.local[40:44, left], LOCAL[40:44, left], atol=1e-9)
    assert (np.abs((made.local * LOCAL).sum(-1))[40:44, right] > np.cos(np.radians(3))).all()


@pytest.mark.parametrize("seed", range(4))
def test_noise_of_the_paper_is_not_taken_for_it(seed: int):
    _, noisy, _ = paper_noise(ROOTS, LOCAL, np.random.default_rng(seed))
    assert not any(exchanged_frames(noisy, limb).any() for limb in LIMBS)


def test_a_jump_that_does_not_exchange_sides_is_none():
    jumped = np.concatenate([LOCAL[:60], LOCAL[100:]])
    mirrored = LOCAL.copy()
    mirrored[70:] = LOCAL[::-1][: len(LOCAL) - 70]
    assert not any(exchanged_frames(each, limb).any() for each in (jumped, mirrored) for limb in LIMBS)
