"""Segmentation into splines: against a plain reference, and what must not change it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.kinematics.spline_segments import best_segments, fitted_splines, segment_errors, spline_frames


def smooth_motion(rng: np.random.Generator, frames: int, features: int) -> np.ndarray:
    """A random walk that is smoothed, so that cubics fit pieces of it."""
    steps = rng.normal(size=(frames + 20, features))
    kernel = np.hanning(21)
    return np.stack(
        [np.convolve(np.cumsum(steps[:, f]), kernel / kernel.sum(), "valid") for f in range(features)], axis=1
    )[:frames]


def plain_error(features: np.ndarray, first: int, last: int, degree: int = 3) -> float:
    """The squared residual of one cubic by NumPy's polynomial fit."""
    if last - first <= degree:
        return 0.0
    times = np.linspace(0, 1, last - first + 1)
    fitted = np.polynomial.polynomial.polyfit(times, features[first : last + 1], degree)
    return float(np.square(np.polynomial.polynomial.polyval(times, fitted).T - features[first : last + 1]).sum())


def plain_cost(features: np.ndarray, price: float, longest: int, degree: int) -> float:
    """Equation 2 with every pair of frames, each fitted anew."""
    costs = [0.0]
    for last in range(1, len(features)):
        costs.append(
            min(
                costs[k] + plain_error(features, k, last, degree) + price for k in range(max(0, last - longest), last)
            )
        )
    return costs[-1]


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000), frames=st.integers(2, 45), features=st.integers(1, 5), degree=st.integers(1, 3),
    longest=st.integers(1, 60), price=st.floats(0.01, 30), far=st.sampled_from([0.0, 300.0]),
)  # fmt: skip
def test_costs_are_those_of_a_plain_reference(seed, frames, features, longest, price, far, degree):
    motion = smooth_motion(np.random.default_rng(seed), frames, features) + far
    found = best_segments(motion, price, longest, degree)
    assert found.junctions[0] == 0 and found.junctions[-1] == frames - 1
    assert (np.diff(found.junctions) >= 1).all() and np.diff(found.junctions).max(initial=1) <= max(1, longest)
    assert found.cost == pytest.approx(plain_cost(motion, price, longest, degree), rel=1e-6, abs=1e-6)
    own = sum(
        plain_error(motion, a, b, degree) + price for a, b in zip(found.junctions, found.junctions[1:], strict=False)
    )
    assert own == pytest.approx(found.cost, rel=1e-6, abs=1e-6)


def test_errors_of_all_pairs_agree_over_the_borders_of_blocks(monkeypatch):
    from stages.shared.kinematics import spline_segments

    motion = smooth_motion(np.random.default_rng(1), 90, 6) * 40 + 500
    whole = segment_errors(motion, 33)
    monkeypatch.setattr(spline_segments, "_BLOCK", 17)
    np.testing.assert_allclose(segment_errors(motion, 33), whole, atol=1e-4)
    for steps in (4, 11, 33):
        for first in (0, 16, 17, 90 - 1 - steps):
            assert whole[steps, first] == pytest.approx(plain_error(motion, first, first + steps), abs=1e-4)
    assert np.isinf(whole[33, 60])


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), scale=st.floats(0.1, 20))
def test_junctions_do_not_depend_on_the_place_and_follow_the_unit(seed, scale):
    rng = np.random.default_rng(seed)
    motion = smooth_motion(rng, 60, 4)
    found = best_segments(motion, 2.0, 40)
    moved = best_segments(motion * scale + rng.normal(size=4) * 10, 2.0 * scale**2, 40)
    assert moved.cost == pytest.approx(found.cost * scale**2, rel=1e-5, abs=1e-6)


def test_exact_cubics_are_found_where_they_meet():
    times = np.linspace(0, 1, 21)[:, None]
    first = times**3 * np.array([[3.0, -2.0]])
    second = first[-1] - times * np.array([[8.0, 5.0]])
    motion = np.concatenate([first, second[1:]])
    found = best_segments(motion, 1e-3, 40)
    assert found.junctions.tolist() == [0, 20, 40]
    np.testing.assert_allclose(found.errors, 0, atol=1e-8)
    splines = fitted_splines(motion, found.junctions)
    np.testing.assert_allclose(spline_frames(splines, found.junctions), motion, atol=1e-9)


def test_a_higher_price_never_gives_more_segments():
    motion = smooth_motion(np.random.default_rng(3), 200, 6)
    counts = [len(best_segments(motion, price, 200).junctions) for price in (0.1, 1.0, 10.0, 100.0)]
    assert counts == sorted(counts, reverse=True)


def test_one_and_two_frames():
    assert best_segments(np.zeros((1, 3)), 1.0, 5).junctions.tolist() == [0]
    assert best_segments(np.zeros((2, 3)), 1.0, 5).junctions.tolist() == [0, 1]
