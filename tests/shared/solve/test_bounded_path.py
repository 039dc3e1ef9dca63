"""The nearest shift within limits: against a general solver, and what is within the limits stays as it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import NonlinearConstraint, minimize

from stages.shared.solve.bounded_path import TOLERANCE, bounded_shift

SPAN = 1.8


def lengths(points: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(T - 2, P) of the second differences."""
    return np.linalg.norm(np.diff(points + shift[:, None], n=2, axis=0), axis=-1)


def case(frames: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A wanted shift that jumps, two gliding points, pins at both ends, and weights."""
    rng = np.random.default_rng(seed)
    wanted = np.repeat(0.05 * rng.normal(size=(frames // 4 + 1, 3)), 4, axis=0)[:frames]
    glide = np.linspace(0, 1, frames)[:, None] * rng.normal(size=3) + 0.01 * np.sin(np.arange(frames))[:, None]
    points = np.stack([glide, glide + np.array([0, 0.1, 0])], axis=1)
    pinned = np.zeros(frames, bool)
    pinned[[0, -1]] = True
    wanted[pinned] = 0
    return wanted, points, pinned, rng.choice([0.01, 1.0], frames)


@settings(max_examples=30, deadline=None)
@given(frames=st.integers(3, 80), seed=st.integers(0, 2**32 - 1), limit=st.floats(0.001, 0.05))
def test_no_point_bends_more_than_it_may(frames: int, seed: int, limit: float) -> None:
    wanted, points, pinned, weights = case(frames, seed)
    limits = np.full(frames - 2, limit)
    shift = bounded_shift(wanted, points, limits, pinned, weights, span=SPAN, iterations=5000)
    assert (shift[pinned] == 0).all()
    allowed = np.maximum(limit, lengths(points, 0 * shift))
    assert (lengths(points, shift) <= allowed * (1 + TOLERANCE) + 1e-9).all()


@pytest.mark.parametrize("seed", range(3))
def test_it_is_as_near_as_a_general_solver_finds(seed: int) -> None:
    frames, limit = 12, 0.02
    wanted, points, pinned, weights = case(frames, seed)

    def whole(inner: np.ndarray) -> np.ndarray:
        shift = np.zeros((frames, 3))
        shift[~pinned] = inner.reshape(-1, 3)
        return shift

    def cost(inner: np.ndarray) -> float:
        away = whole(inner) - wanted
        return float((weights[:, None] * away**2).sum() + SPAN**4 * (np.diff(away, n=2, axis=0) ** 2).sum())

    allowed = np.maximum(limit, lengths(points, np.zeros((frames, 3)))).ravel() ** 2
    within = NonlinearConstraint(lambda inner: lengths(points, whole(inner)).ravel() ** 2 - allowed, -np.inf, 0)
    slow = minimize(cost, np.zeros(3 * (frames - 2)), method="SLSQP", constraints=[within], options={"maxiter": 500})
    assert slow.success
    limits = np.full(frames - 2, limit)
    fast = bounded_shift(wanted, points, limits, pinned, weights, span=SPAN, iterations=5000)
    assert cost(fast[~pinned].ravel()) <= 1.01 * slow.fun
    np.testing.assert_allclose(fast, whole(slow.x), atol=2e-3)


def test_a_shift_within_the_limits_stays_as_it_is() -> None:
    wanted, points, pinned, weights = case(40, 0)
    shift = bounded_shift(wanted, points, np.full(38, 1.0), pinned, weights, span=SPAN)
    assert np.array_equal(shift, wanted)


def test_a_point_that_exceeds_the_limit_by_itself_may_do_as_it_does() -> None:
    wanted, points, pinned, weights = case(40, 1)
    shift = bounded_shift(0 * wanted, points, np.zeros(38), pinned, weights, span=SPAN)
    assert (shift == 0).all()
