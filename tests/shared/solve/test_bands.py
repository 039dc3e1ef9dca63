"""What the foot lock writes out for speed, beside the library functions that it stands for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solveh_banded

from stages.shared.kinematics.rotations import rotate
from stages.shared.solve.bending import solve_bands
from stages.shared.solve.limb_solve import _slopes


@pytest.mark.parametrize(("bands", "columns"), [(3, (3,)), (9, ()), (1, (2,))])
def test_banded_equations_have_the_bytes_of_scipy(bands: int, columns: tuple[int, ...]):
    rng = np.random.default_rng(bands)
    matrix, right = rng.normal(size=(bands, 40)), rng.normal(size=(40, *columns))
    matrix[0] += 20
    given = matrix.copy(), right.copy()
    found = solve_bands(matrix, right)
    assert found.shape == right.shape
    np.testing.assert_array_equal(found, solveh_banded(matrix, right, lower=True))
    np.testing.assert_array_equal(matrix, given[0])  # neither is written to
    np.testing.assert_array_equal(right, given[1])


def test_a_matrix_that_is_not_positive_is_refused():
    with pytest.raises(np.linalg.LinAlgError, match="row 1"):
        solve_bands(np.array([[-1.0, 1.0, 1.0]]), np.ones(3))


def test_slopes_are_the_axes_across_the_arms():
    rng = np.random.default_rng(0)
    rotations, arms = rng.normal(size=(7, 3, 4)), rng.normal(size=(7, 3, 3))
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    axes = np.stack([rotate(rotations, np.broadcast_to(axis, arms.shape)) for axis in np.eye(3)], axis=2)
    np.testing.assert_allclose(_slopes(rotations, arms), np.cross(axes, arms[:, :, None]), atol=1e-14, rtol=0)
