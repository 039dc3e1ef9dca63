"""The noise of capture: left and right are exchanged exactly, and what no fault touches keeps its numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.humanoid.symmetric_pairs import pairs_of_limbs
from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.swapped_sides import exchanged
from stages.shared.pointcloud.rig import rig_of_motion
from stages.shared.pose_tasks.denoise import limbs_of_rig
from stages.shared.pose_tasks.noise import FAULTS, NOISES, SWAPPED, capture_noise
from stages.shared.pose_tasks.registry import task_named
from tests.shared.inference.examples import humanoid, swinging

SKELETON = humanoid()
MOTION = swinging(SKELETON, 128)
LOCAL = local_rotations_of(SKELETON, MOTION)
ROOTS = MOTION.root_positions.astype(float)
LIMBS = pairs_of_limbs(SKELETON.names, SKELETON.parents, SKELETON.offsets, SKELETON.groups)
ARMS, LEGS = LIMBS


def drawn(noise: str, seed: int, limbs=LIMBS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return NOISES[noise](ROOTS, LOCAL, np.random.default_rng(seed), limbs)


def test_limbs_are_found_by_names_and_by_shape_alike():
    assert {tuple(pair) for pair in ARMS} == {(3, 6), (4, 7)} and {tuple(pair) for pair in LEGS} == {(8, 10), (9, 11)}
    bare = pairs_of_limbs(("",) * SKELETON.joints, SKELETON.parents, SKELETON.offsets, SKELETON.groups)
    assert all((one == other).all() for one, other in zip(bare, LIMBS, strict=True))
    rig = rig_of_motion(SKELETON, MOTION)  # the finger is no bone of the body, so later bones move up by one
    assert [limb.tolist() for limb in limbs_of_rig(rig)] == [[[3, 5], [4, 6]], [[7, 9], [8, 10]]]


@pytest.mark.parametrize("seed", range(6))
def test_a_swap_is_exact_and_all_else_keeps_its_numbers(seed: int):
    roots, local, noisy = drawn(SWAPPED, seed)
    assert (roots == ROOTS).all()
    swapped = [limb for limb in LIMBS if noisy[:, limb].any()]
    frames = np.flatnonzero(noisy.any(axis=1))
    assert swapped and 5 <= len(frames) <= 45 and (np.diff(frames) == 1).all()
    expected = LOCAL
    for left, right in np.concatenate(swapped):
        expected = expected.copy()
        expected[frames, left], expected[frames, right] = LOCAL[frames, right], LOCAL[frames, left]
    np.testing.assert_array_equal(local, expected)
    assert (local[~noisy] == LOCAL[~noisy]).all() and (noisy.sum(0) % len(frames) == 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_capture_exchanges_after_all_other_faults(seed: int):
    """A rig without pairs gets the same other faults; with pairs, they are exchanged in one stretch exactly."""
    plain, both = drawn("capture", seed, limbs=()), drawn("capture", seed)
    np.testing.assert_array_equal(plain[0], both[0])
    apart = (plain[1] != both[1]).any(axis=-1)
    at = apart.any(axis=1)
    back = both[1]
    for limb in LIMBS:
        if apart[:, limb].any():
            back = exchanged(back, np.arange(np.flatnonzero(at)[0], np.flatnonzero(at)[-1] + 1), limb)
    np.testing.assert_array_equal(back, plain[1])
    assert at.any() and both[2][at].any(axis=1).all()


def test_a_fault_that_is_left_out_changes_no_other():
    """The faults of one draw are those of the draws of each fault alone, where one touches a joint."""
    whole = capture_noise(ROOTS, LOCAL, np.random.default_rng(3), LIMBS, faults=FAULTS[1:])
    alone = [capture_noise(ROOTS, LOCAL, np.random.default_rng(3), (), faults=(fault,)) for fault in FAULTS[1:]]
    exchange = capture_noise(ROOTS, LOCAL, np.random.default_rng(3), LIMBS, faults=(SWAPPED,))
    marks = sum(each[2].astype(int) for each in alone)
    swapped = np.asarray(exchange[2].any(axis=1))
    for each in alone:
        once = each[2] & (marks == 1) & ~swapped[:, None]
        np.testing.assert_array_equal(whole[1][once], each[1][once])
    untouched = (marks == 0) & ~swapped[:, None]
    assert (whole[1][untouched] == LOCAL[untouched]).all()


@pytest.mark.parametrize("fault", ["frozen", "lost"])
def test_single_faults_are_what_their_names_say(fault: str):
    roots, local, noisy = drawn(fault, 1)
    assert (roots == ROOTS).all() and (local[~noisy] == LOCAL[~noisy]).all()
    (joint,) = np.flatnonzero(noisy.any(axis=0))
    values = local[noisy[:, joint], joint]
    assert (values == (values[0] if fault == "frozen" else [0, 0, 0, 1])).all()


def test_a_rig_without_pairs_is_told():
    """The right side of this rig is one joint, not paired by name or by shape with any of the left."""
    with pytest.raises(InputError, match="no pairs of left and right"):
        drawn(SWAPPED, 0, limbs=())
    groups = np.where(SKELETON.groups > 0, 0, SKELETON.groups).astype(np.int8)
    names = tuple(name.replace("left", "one").replace("right", "two") for name in SKELETON.names)
    rig = rig_of_motion(replace(SKELETON, groups=groups, names=names), MOTION)
    assert "no pairs" in task_named("denoise", rig, "capture").notes[0]
    assert not task_named("denoise", rig, "paper").notes
    with pytest.raises(InputError, match="no pairs of left and right"):
        task_named("denoise", rig, SWAPPED)
    assert not task_named("denoise", rig_of_motion(SKELETON, MOTION), "capture").notes
