"""Spectra of velocities: against sums over sines, power in time, and what moves and turns a motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.statistics.spectra import BANDS_HZ, band_power, velocity_density

FPS = 30.0


def noise(seed: int, frames: int = 121, joints: int = 3) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).normal(size=(2, frames, joints, 3)), axis=1) / FPS


def test_every_density_is_the_sum_over_sines() -> None:
    """Written out: |sum of window * (velocity - mean) * e^(-i w t)|^2, one-sided, over the window's energy."""
    positions = noise(1, 40)
    frequencies, found = velocity_density(positions, FPS, bins=64)
    velocities = np.diff(positions, axis=1) * FPS
    velocities -= velocities.mean(axis=1, keepdims=True)
    times = np.arange(39)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * times / 39)  # periodic Hann
    for k in (0, 1, 7, 31, 32):
        wave = np.exp(-2j * np.pi * k * times / 64)
        power = np.abs((window[:, None, None] * velocities * wave[:, None, None]).sum(axis=1)) ** 2
        expected = (1 if k in (0, 32) else 2) * power / (FPS * (window**2).sum())
        np.testing.assert_allclose(found[:, k], expected.sum(axis=-1).mean(axis=-1), rtol=1e-9, atol=1e-12)
        assert frequencies[k] == pytest.approx(k * FPS / 64)


def test_the_bands_hold_what_moves_at_their_rate() -> None:
    times = np.arange(121) / FPS
    for rate, expected in ((1.0, 0), (3.5, 1), (9.0, 2)):
        positions = np.zeros((1, 121, 2, 3))
        positions[..., 1] = np.sin(2 * np.pi * rate * times)[None, :, None] / (2 * np.pi * rate)
        frequencies, density = velocity_density(positions, FPS)
        powers = [float(band_power(frequencies, density, band)[0]) for band in BANDS_HZ]
        assert int(np.argmax(powers)) == expected and powers[expected] > 0.9 * sum(powers)
        # The mean square of a sine of 1 m/s; differences of 30 frames a second lose a sixth of it at 9 Hz.
        assert sum(powers) == pytest.approx(0.5 * np.sinc(rate / FPS) ** 2, rel=0.1)


def test_white_noise_has_its_variance() -> None:
    velocities = np.random.default_rng(2).normal(size=(400, 120, 1, 3))
    positions = np.concatenate([np.zeros((400, 1, 1, 3)), np.cumsum(velocities, axis=1) / FPS], axis=1)
    frequencies, density = velocity_density(positions, FPS)
    assert density.mean(axis=0).sum() * frequencies[1] == pytest.approx(3.0, rel=0.03)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.floats(-50, 50), st.floats(-3, 3))
def test_place_heading_and_steady_travel_change_nothing(seed: int, far: float, speed: float) -> None:
    positions = noise(seed, 50)
    turn = Rotation.random(random_state=seed % 2**31).as_matrix()
    moved = positions @ turn.T + far + speed * np.arange(50)[None, :, None, None] / FPS
    np.testing.assert_allclose(
        velocity_density(moved, FPS)[1], velocity_density(positions, FPS)[1], rtol=1e-6, atol=1e-9
    )


def test_longer_windows_than_the_transform_are_refused() -> None:
    with pytest.raises(ValueError, match="129 velocities"):
        velocity_density(np.zeros((1, 130, 1, 3)), FPS)
    assert velocity_density(np.zeros((1, 130, 1, 3)), FPS, bins=256)[1].shape == (1, 129)
