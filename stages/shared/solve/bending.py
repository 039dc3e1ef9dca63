"""Second derivatives of values at uneven times, and their squares as the bands of a matrix.

With D the matrix that takes second derivatives and W diagonal, D'WD has a diagonal and two bands on either side. It
is what bending costs in `smoothing`, `limb_solve` and `bounded_path`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import get_lapack_funcs

_PBSV = get_lapack_funcs(("pbsv",), dtype=np.float64)[0]


class SecondDerivative(NamedTuple):
    """D at N times: the second derivative at inner time i is left * c[i-1] + middle * c[i] + right * c[i+1].

    left, middle, right: (N - 2,). width: (N - 2,) the time that each inner time represents.
    """

    left: np.ndarray
    middle: np.ndarray
    right: np.ndarray
    width: np.ndarray

    @classmethod
    def at(cls, times: np.ndarray) -> SecondDerivative:
        """D at times (N,), strictly rising."""
        h = np.diff(times)
        width = (h[:-1] + h[1:]) / 2
        left, right = 1 / (h[:-1] * width), 1 / (h[1:] * width)
        return cls(left, -(left + right), right, width)

    def squared(self, weights: np.ndarray) -> np.ndarray:
        """(3, N) the diagonal of D'WD, and the first and second band below it; weights (N - 2,)."""
        left, middle, right, _ = self
        bands = np.zeros((3, len(left) + 2))
        bands[0, :-2] += weights * left**2
        bands[0, 1:-1] += weights * middle**2
        bands[0, 2:] += weights * right**2
        bands[1, :-2] += weights * left * middle
        bands[1, 1:-1] += weights * middle * right
        bands[2, :-2] += weights * left * right
        return bands

    def transposed(self, values: np.ndarray) -> np.ndarray:
        """D' (N, F) of values (N - 2, F)."""
        out = np.zeros((len(values) + 2, values.shape[1]))
        out[:-2] += self.left[:, None] * values
        out[1:-1] += self.middle[:, None] * values
        out[2:] += self.right[:, None] * values
        return out


def solve_bands(bands: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x, float64, with A x = `right`, both (N, F) or (N,). A is symmetric and positive definite; `bands` (U, N) are
    its diagonal and its lower bands.

    It calls LAPACK's function as SciPy's solveh_banded does, without the checks for NaN, which take longer than the
    solve of a short clip.

    Raises: LinAlgError if A is not positive definite.
    """
    _, found, fault = _PBSV(bands, right, lower=1)
    if fault:
        raise np.linalg.LinAlgError(f"The matrix is not positive definite at row {fault}.")
    return found
