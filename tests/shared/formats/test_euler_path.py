"""Euler curves between two keys: the next key's own form is reached without a jump wherever a curve does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.formats.euler import LOCKED, angles_near, other_triple, to_quaternions
from stages.shared.formats.euler_path import JUMP_DEGREES, largest_step, path_between, through_lock
from stages.shared.formats.euler_rows import EulerJump, sentences_of_jumps

ORDER = "ZXY"


def same_rotations(one: np.ndarray, other: np.ndarray, axes: str = ORDER) -> bool:
    dots = (to_quaternions(one, axes) * to_quaternions(other, axes)).sum(-1)
    return bool((np.abs(dots) > 1 - 1e-9).all())


def junk_forms(curve: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The same rotations in forms drawn frame by frame."""
    other = rng.integers(0, 2, (len(curve), 1)) == 1
    return np.where(other, other_triple(curve), curve) + 360.0 * rng.integers(-2, 3, curve.shape)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 30), st.floats(1.0, 25.0))
def test_a_smooth_curve_in_any_forms_is_found_again_without_a_jump(seed, frames, speed):
    rng = np.random.default_rng(seed)
    curve = rng.uniform(-170, 170, 3) + np.cumsum(rng.uniform(-speed, speed, (frames + 2, 3)), axis=0)
    found = path_between(junk_forms(curve[1:-1], rng), curve[0], curve[-1])
    assert found is not None and same_rotations(found, curve[1:-1])
    assert largest_step(found, curve[0], curve[-1]) <= JUMP_DEGREES
    steps = [np.diff(np.concatenate([curve[:1], each, curve[-1:]]), axis=0) for each in (found, curve[1:-1])]
    assert (steps[0] ** 2).sum() <= (steps[1] ** 2).sum() + 1e-6


def test_a_curve_close_to_gimbal_lock_keeps_the_triple_that_the_next_key_has():
    """The nearest form of each frame alone takes the other triple beside the lock, and arrives in it."""
    middle = np.linspace(70, 110, 21)
    curve = np.stack([np.linspace(-20, 60, 21), middle, np.linspace(0, 90, 21)], -1) + 0.3
    near = np.full_like(curve, np.nan)
    near[0] = curve[0]
    wrong = np.where(middle[:, None] > 90, other_triple(curve), curve)  # as a follower that changed at the lock
    found = path_between(wrong[1:-1], curve[0], curve[-1])
    assert found is not None and np.allclose(found, curve[1:-1], atol=1e-6)
    assert same_rotations(angles_near(to_quaternions(curve, ORDER), ORDER, near), curve)


def test_a_whole_turn_is_not_made_of_two_half_turns_from_triple_to_triple():
    turning = np.stack([np.linspace(100, 190, 10), np.full(10, 20.0), np.full(10, 5.0)], -1)
    assert path_between(turning[1:-1], turning[0], turning[-1] - np.array([360.0, 0, 0])) is None


def test_keys_a_whole_turn_apart_have_no_curve_without_a_jump():
    still = np.tile([10.0, 0.0, 20.0], (8, 1))
    assert path_between(still, still[0], still[0] + [360.0 * 3, 0, 0]) is None


@pytest.mark.parametrize("middle", [90.0, -90.0, 270.0])
def test_a_joint_that_stands_at_gimbal_lock_keeps_its_channels_still(middle):
    key = np.array([30.0, middle, -50.0])
    turn = 1.0 if np.sin(np.deg2rad(middle)) > 0 else -1.0  # ZXY is a cyclic order
    rng = np.random.default_rng(0)
    slide = rng.uniform(-90, 90, (9, 1))
    noisy = key + slide * np.array([1.0, 0.0, -turn])
    assert same_rotations(noisy, np.tile(key, (9, 1)))
    found = through_lock(noisy, key, key, ORDER)
    assert found is not None and np.allclose(found, key, atol=1e-6)


def test_two_channels_take_the_form_of_the_next_key():
    curve = np.stack([np.linspace(-170, -300, 12), np.linspace(5, 40, 12)], -1)
    found = path_between(curve[1:-1] + np.array([360.0, 0.0]), curve[0], curve[-1])
    assert found is not None and np.allclose(found, curve[1:-1])


def test_jumps_are_told_with_joint_and_frame():
    jumps = [EulerJump(f"Joint{at}", at) for at in range(6)]
    (sentence,) = sentences_of_jumps(jumps, 10)
    assert "Joint0 into frame 10" in sentence and "and 2 more" in sentence
    assert sentences_of_jumps([], 0) == []


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_two_channels_keep_their_rotations_through_ninety_degrees(seed: int) -> None:
    """Two channels have one triple only: what would be the other one turns about a third axis."""
    drawn = np.random.default_rng(seed)
    angles = np.stack([np.linspace(*drawn.uniform(-40, 40, 2), 20), np.linspace(*drawn.uniform(60, 120, 2), 20)], -1)
    first, last = angles[0], angles[-1] + 360.0 * drawn.integers(-1, 2, 2)
    found = path_between(angles[1:-1], first, last)
    if found is not None:
        made, meant = (Rotation.from_euler("XY", each, degrees=True) for each in (found, angles[1:-1]))
        assert (made.inv() * meant).magnitude().max() < 1e-6
    if (last == angles[-1]).all() and np.abs(np.cos(np.deg2rad(angles[:, 1]))).min() >= LOCKED:
        assert found is not None
