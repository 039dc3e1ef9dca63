"""Second derivatives at uneven times, and their squares, against dense matrices."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.solve.bending import SecondDerivative


def dense(derivative: SecondDerivative) -> np.ndarray:
    """D as a matrix (N - 2, N)."""
    count = len(derivative.left)
    out = np.zeros((count, count + 2))
    for row in range(count):
        out[row, row : row + 3] = derivative.left[row], derivative.middle[row], derivative.right[row]
    return out


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 12), st.integers(0, 2**32 - 1))
def test_squares_and_transposes_are_those_of_the_matrix(frames: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.2, 2.0, frames))
    derivative = SecondDerivative.at(times)
    matrix, weights = dense(derivative), rng.uniform(0.1, 3.0, frames - 2)
    np.testing.assert_allclose(matrix @ np.stack([np.ones(frames), times], 1), 0, atol=1e-9)
    np.testing.assert_allclose(matrix @ times**2, 2, atol=1e-9)
    whole = matrix.T @ (weights[:, None] * matrix)
    bands = derivative.squared(weights)
    for away in range(min(3, frames)):
        np.testing.assert_allclose(bands[away, : frames - away], np.diagonal(whole, -away), atol=1e-9)
    values = rng.normal(size=(frames - 2, 3))
    np.testing.assert_allclose(derivative.transposed(values), matrix.T @ values, atol=1e-9)
