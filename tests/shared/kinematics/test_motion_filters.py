"""Plain filters: what they keep, what they take off, and slow references beside the fast ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.kinematics.motion_filters import (
    EURO_HZ,
    EURO_SLOPE,
    EURO_SPEED_HZ,
    FILTERS,
    LAPLACIAN_S,
    filter_rotations,
    laplacian,
    one_euro,
)

FPS = 30.0
NAMES = sorted(FILTERS)


def noise(frames: int = 80, columns: int = 3, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((frames, columns))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5, 9, 80])
def test_what_stands_still_stays(name: str, frames: int):
    still = np.full((frames, 2), 3.5)
    np.testing.assert_allclose(FILTERS[name](still, FPS, 1.0), still, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_noise_shrinks_and_more_with_width(name: str):
    narrow, wide = (FILTERS[name](noise(), FPS, width).std() for width in (1.0, 4.0))
    assert wide < narrow < noise().std()


@pytest.mark.parametrize("name", ["savgol", "butterworth", "laplacian"])
def test_filters_look_both_ways_alike(name: str):
    values = noise()
    back = FILTERS[name](values[::-1].copy(), FPS, 1.0)[::-1]
    inside = slice(20, -20)  # Butterworth's ends differ a little
    np.testing.assert_allclose(FILTERS[name](values, FPS, 1.0)[inside], back[inside], atol=1e-3)


@pytest.mark.parametrize("name", ["savgol", "laplacian"])
def test_a_straight_line_stays(name: str):
    line = np.arange(60.0)[:, None] * [0.1, -2.0]
    np.testing.assert_allclose(FILTERS[name](line, FPS, 1.0), line, atol=1e-9)


def test_laplacian_is_a_matrix_to_a_power():
    values, frames = noise(20), 20
    matrix = np.eye(frames)
    for row in range(1, frames - 1):
        matrix[row, row - 1 : row + 2] = [0.25, 0.5, 0.25]
    rounds = max(1, round((4 * LAPLACIAN_S * FPS) ** 2 / 0.5))
    np.testing.assert_allclose(laplacian(values, FPS, 4.0), np.linalg.matrix_power(matrix, rounds) @ values)


def test_one_euro_is_the_papers_loop():
    """Casiez 2012, algorithm 1, one column at a time in plain Python."""
    values = noise(30)

    def share(cutoff: float) -> float:
        return 1 / (1 + FPS / (2 * np.pi * cutoff))

    expected = values.copy()
    for column in range(3):
        speed = 0.0
        for frame in range(1, 30):
            slope = (values[frame, column] - expected[frame - 1, column]) * FPS
            speed = speed + share(EURO_SPEED_HZ) * (slope - speed)
            a = share((EURO_HZ + EURO_SLOPE * abs(speed)) / 2.0)
            expected[frame, column] = a * values[frame, column] + (1 - a) * expected[frame - 1, column]
    np.testing.assert_allclose(one_euro(values, FPS, 2.0), expected)


@given(st.integers(0, 1000))
def test_signs_of_quaternions_mean_nothing_and_lengths_stay_one(seed: int):
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(0.3 * rng.standard_normal((40 * 2, 3)).cumsum(0) / 6).as_quat().reshape(40, 2, 4)
    flipped = turns * rng.choice([-1.0, 1.0], (40, 2, 1))
    one, other = (filter_rotations(each, FPS, FILTERS["laplacian"], 2.0) for each in (turns, flipped))
    np.testing.assert_allclose(np.abs((one * other).sum(-1)), 1, atol=1e-9)
