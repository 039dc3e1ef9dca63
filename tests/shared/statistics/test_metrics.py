"""The figures against hand values, plain loops, and what must hold whatever the data."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.statistics import metrics


def random_pose(seed: int, frames: int = 12, joints: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    quaternions = Rotation.random(frames * joints, rng=rng).as_quat().reshape(frames, joints, 4)
    return rng.normal(size=(frames, joints, 3)), quaternions


def slow_npss(predicted: np.ndarray, true: np.ndarray, real_only: bool) -> tuple[float, float]:
    """The definition in plain loops, with its own Fourier sum."""
    frames, features = true.shape

    def power(signal: np.ndarray) -> list[float]:
        out = []
        for f in range(frames):
            z = sum(signal[t] * cmath.exp(-2j * math.pi * f * t / frames) for t in range(frames))
            out.append(z.real**2 if real_only else abs(z) ** 2)
        return out

    total = weighted = 0.0
    for feature in range(features):
        p, q = power(predicted[:, feature]), power(true[:, feature])
        distance, at_p, at_q = 0.0, 0.0, 0.0
        for f in range(frames):
            at_p += p[f] / sum(p)
            at_q += q[f] / sum(q)
            distance += abs(at_p - at_q)
        weighted += distance * sum(q)
        total += sum(q)
    return weighted / total, total


def test_l2p_of_one_joint_off_by_a_hand_value() -> None:
    true = np.zeros((4, 2, 3))
    predicted = true.copy()
    predicted[1, 0] = (3, 4, 0)  # 5 m in one of four frames
    predicted[2] = 1  # every joint and axis 1 m off: sqrt(6)
    assert metrics.l2p_m(predicted, true) == pytest.approx((5 + math.sqrt(6)) / 4)
    assert metrics.mpjpe_mm(predicted, true) == pytest.approx(1000 * (5 + 2 * math.sqrt(3)) / 8)


def test_l2q_of_a_quarter_turn_and_of_a_flipped_sign() -> None:
    true = np.tile([0.0, 0, 0, 1], (2, 1, 1))
    turned = np.tile(Rotation.from_euler("y", 90, degrees=True).as_quat(), (2, 1, 1))
    expected = math.sqrt(2 - 2 * math.cos(math.pi / 4))
    assert metrics.l2q(turned, true) == pytest.approx(expected)
    assert metrics.l2q(-turned, true) == pytest.approx(expected)
    assert metrics.l2q_lafan1(-true, true) == pytest.approx(2.0)
    assert metrics.mpjae_deg(-turned, true) == pytest.approx(90)


def test_velocity_and_acceleration_by_hand() -> None:
    true = np.zeros((4, 1, 3))
    predicted = true.copy()
    predicted[:, 0, 0] = [0, 0.001, 0.003, 0.003]  # steps 1, 2, 0 mm; second differences 1, -2 mm
    assert metrics.mpjve_mm(predicted, true) == pytest.approx(1.0)
    assert metrics.acceleration_mm(predicted, true) == pytest.approx(1.5)
    still = np.full_like(true, 0.2)
    assert metrics.mpjve_mm(still, true) == 0


def test_leading_dimensions_are_windows() -> None:
    pairs = [(random_pose(i), random_pose(i + 100)) for i in range(4)]
    predicted, true = ([np.stack([p[k][i] for p in pairs]) for i in (0, 1)] for k in (0, 1))
    for function, part in ((metrics.l2p_m, 0), (metrics.l2q, 1), (metrics.mpjae_deg, 1)):
        one_by_one = [function(p[part], t[part]) for p, t in pairs]
        np.testing.assert_allclose(function(predicted[part], true[part]), one_by_one)


@pytest.mark.parametrize("real_only", [False, True])
def test_npss_equals_the_slow_definition(real_only: bool) -> None:
    predicted, true = (np.random.default_rng(seed).normal(size=(11, 5)) for seed in (1, 2))
    function = metrics.npss_lafan1 if real_only else metrics.npss
    value, weight = function(predicted, true)
    slow_value, slow_weight = slow_npss(predicted, true, real_only)
    assert value == pytest.approx(slow_value)
    assert weight == pytest.approx(slow_weight)


def test_npss_ignores_a_shift_in_time_and_the_real_part_variant_does_not() -> None:
    t = np.arange(64)
    wave = np.sin(2 * np.pi * 4 * t / 64)[:, None]
    shifted = np.roll(wave, 4, axis=0)  # a quarter of its period
    assert metrics.npss(shifted, wave)[0] == pytest.approx(0, abs=1e-9)
    assert metrics.npss_lafan1(shifted, wave)[0] > 1


def test_npss_of_constant_features_is_zero_and_finite() -> None:
    t = np.arange(32)
    true = np.stack([np.zeros(32), np.full(32, 2.0), np.sin(t)], axis=1)
    value, weight = metrics.npss(true, true)
    assert value == 0 and np.isfinite(weight)
    flat, flat_weight = metrics.npss(np.zeros((32, 3)), np.zeros((32, 3)))
    assert flat == 0 and flat_weight == 0
    held = true.copy()
    held[:, 2] = 0  # a held pose is not a perfect one
    assert metrics.npss(held, true)[0] > 0


@given(seed=st.integers(0, 1000))
def test_identical_motions_score_zero(seed: int) -> None:
    positions, quaternions = random_pose(seed)
    for function in (metrics.l2p_m, metrics.mpjpe_mm, metrics.mpjve_mm, metrics.acceleration_mm):
        assert function(positions, positions) == 0
    assert metrics.l2q(-quaternions, quaternions) == 0
    assert metrics.mpjae_deg(quaternions, quaternions) == pytest.approx(0, abs=1e-5)
    features = metrics.pose_features(positions, quaternions)
    assert features.shape == (12, 21)
    assert metrics.npss(features, features)[0] == 0


@given(seed=st.integers(0, 1000))
def test_turning_and_moving_both_motions_changes_no_distance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (p, q), (p2, q2) = random_pose(seed), random_pose(seed + 1)
    turn, shift = Rotation.random(rng=rng), rng.normal(size=3)

    def moved(positions: np.ndarray) -> np.ndarray:
        return turn.apply(positions.reshape(-1, 3)).reshape(positions.shape) + shift

    def turned(quaternions: np.ndarray) -> np.ndarray:
        return (turn * Rotation.from_quat(quaternions.reshape(-1, 4))).as_quat().reshape(quaternions.shape)

    assert metrics.l2p_m(moved(p2), moved(p)) == pytest.approx(metrics.l2p_m(p2, p))
    assert metrics.l2q(turned(q2), turned(q)) == pytest.approx(metrics.l2q(q2, q))
    assert metrics.mpjae_deg(turned(q2), turned(q)) == pytest.approx(metrics.mpjae_deg(q2, q))


def test_lafan1_positions_are_counted_in_training_deviations() -> None:
    true = np.zeros((2, 1, 3))
    predicted = true + np.array([1.0, 2, 4])
    assert metrics.l2p_lafan1(predicted, true, np.array([[1.0, 2, 4]])) == pytest.approx(math.sqrt(3))
