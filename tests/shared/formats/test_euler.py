"""Euler channels: against SciPy, through gimbal lock, and unwrapped to their guides."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.formats import euler

ORDERS = ["".join(order) for order in permutations("XYZ")]


@pytest.mark.parametrize("order", [*ORDERS, "XY", "ZX", "YZ", "X", "Y", "Z"])
def test_quaternions_agree_with_scipy(order: str) -> None:
    angles = np.random.default_rng(0).uniform(-200, 200, (50, 4, len(order)))
    expected = Rotation.from_euler(order, angles.reshape(-1, len(order)), degrees=True)
    got = Rotation.from_quat(euler.to_quaternions(angles, order).reshape(-1, 4))
    assert (expected.inv() * got).magnitude().max() < 1e-12


def test_no_channels_turn_nothing() -> None:
    assert euler.to_quaternions(np.zeros((3, 2, 0)), "").tolist() == [[[0, 0, 0, 1]] * 2] * 3


@pytest.mark.parametrize("order", [*ORDERS, "XY", "ZX", "YZ", "X", "Y", "Z"])
def test_near_the_truth_the_truth_comes_back(order: str) -> None:
    angles = np.random.default_rng(2).uniform(-400, 400, (300, len(order)))
    rotations = euler.to_quaternions(angles, order)
    assert np.allclose(euler.angles_near(rotations, order, angles), angles, atol=1e-6)
    assert np.allclose(euler.angles_near(-rotations, order, angles + 1.0), angles, atol=1e-6)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("middle", [90.0, -90.0, 270.0])
def test_through_gimbal_lock_rotations_stay_true_and_curves_whole(order: str, middle: float) -> None:
    angles = np.linspace([10, middle - 20, -30], [40, middle + 20, 0], 41)
    angles[20, 1] = middle
    rotations = euler.to_quaternions(angles, order)
    unguided = np.full_like(angles, np.nan)
    unguided[0] = angles[0]
    got = euler.angles_near(rotations, order, unguided)
    turned = Rotation.from_euler(order, got, degrees=True).inv() * Rotation.from_quat(rotations)
    assert turned.magnitude().max() < 1e-6
    assert np.allclose(got, angles, atol=0.8)  # in the lock itself one step's share of the outer angles is free


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(ORDERS), st.integers(1, 60), st.integers(1, 20))
def test_all_at_once_equals_one_by_one(seed: int, order: str, frames: int, every: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.cumsum(rng.normal(0, 20, (frames, 3)), axis=0)
    rotations = euler.to_quaternions(angles, order)
    near = np.full_like(angles, np.nan)
    near[::every] = angles[::every] + rng.normal(0, 3, angles[::every].shape)
    guided = np.isfinite(near).all(axis=1)
    first, locked = euler._tait_bryan(rotations, order)
    pair = np.stack([first, euler.other_triple(first)])
    slow = euler._one_by_one(pair, near, guided, locked, euler.parity_of(order))
    assert np.allclose(euler.angles_near(rotations, order, near), slow, atol=1e-9)


def test_curves_do_not_jump_where_rotations_do_not() -> None:
    angles = np.linspace([0, 0, 0], [1500, 50, -900], 400)
    got = euler.angles_near(euler.to_quaternions(angles, "ZXY"), "ZXY", np.full_like(angles, np.nan))
    assert np.allclose(got, angles, atol=1e-6)
