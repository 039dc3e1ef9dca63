"""Errors of detectors: none if none are asked for, in proportion to the person's size, and of the stated shares."""

from __future__ import annotations

import numpy as np

from stages.shared.humanoid.detector_errors import DETECTOR, NONE, DetectorErrors, with_errors
from stages.shared.humanoid.landmarks import LANDMARKS


def _places(frames: int = 200) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.cumsum(rng.normal(size=(1, len(LANDMARKS), 2)), axis=1) + np.zeros((frames, 1, 1))


def test_without_errors_the_places_are_the_true_ones():
    places, trust = with_errors(_places(), np.random.default_rng(0), NONE)
    np.testing.assert_allclose(places, _places())
    assert (trust > 0).all()


def test_noise_is_in_proportion_to_the_persons_size():
    noisy = DetectorErrors(missing=0, hidden=0, swapped=0, outliers=0)
    one, _ = with_errors(_places(), np.random.default_rng(0), noisy)
    other, _ = with_errors(100 * _places(), np.random.default_rng(0), noisy)
    np.testing.assert_allclose(other, 100 * one, rtol=1e-9)
    apart = np.abs(one - _places()).mean(axis=(0, 2))
    assert apart[LANDMARKS.index("left_hip")] > 2 * apart[LANDMARKS.index("nose")] > 0


def test_what_is_missing_has_no_confidence():
    gone = 0.0
    for seed in range(20):
        places, trust = with_errors(_places(), np.random.default_rng(seed), DETECTOR)
        missing = ~np.isfinite(places).all(axis=-1)
        assert (missing == (trust == 0)).all() and (trust <= 1).all()
        gone += missing.mean() / 20
    assert 0.01 < gone < 0.3


def test_sides_are_exchanged_for_a_while():
    swapped = DetectorErrors(noise=0, missing=0, hidden=0, swapped=1, outliers=0)
    places, _ = with_errors(_places(), np.random.default_rng(0), swapped)
    left, right = (LANDMARKS.index(f"{side}_knee") for side in ("left", "right"))
    moved = np.flatnonzero(np.abs(places[:, left] - _places()[:, left]).max(axis=1) > 1e-9)
    assert 0 < len(moved) <= 30 and len(moved) == np.ptp(moved) + 1
    np.testing.assert_allclose(places[moved, left], _places()[moved, right])


def test_the_same_generator_gives_the_same_errors():
    one, other = (with_errors(_places(), np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(one[0], other[0])
