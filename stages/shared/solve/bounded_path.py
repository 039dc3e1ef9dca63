"""The path nearest to a wanted one on which no point that rides along accelerates more than it may.

Several points have paths of their own, b_j. One shift s over time is added to all of them. With D second differences,
w the weight of a frame and d the shift that is wanted, the shift found makes

    sum over t of w |s - d|^2 + span^4 |D s - D d|^2

least, among the shifts with |D (b_j + s)| <= limit in every frame and for every point. The problem is convex. It is
solved by the alternating direction method of multipliers (Boyd et al., Distributed Optimization and Statistical
Learning via ADMM, 2011, section 3.1 with relaxation, 3.4.3): a banded solve, whose matrix never changes, alternates
with a projection of every acceleration into its ball.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky_banded, get_lapack_funcs

from stages.shared.solve.bending import SecondDerivative
from stages.shared.solve.smoothing import PINNED

RELAXATION = 1.6
CHECK_EVERY, TOLERANCE = 10, 0.01  # rounds; second differences may exceed their limits by this share
# What SciPy's cho_solve_banded calls, without its checks, which take longer than the solve of a short clip.
_PBTRS = get_lapack_funcs(("pbtrs",), dtype=np.float64)[0]


def bounded_shift(
    wanted: np.ndarray,
    points: np.ndarray,
    limits: np.ndarray,
    pinned: np.ndarray,
    weights: np.ndarray,
    *,
    span: float,
    iterations: int = 200,
) -> np.ndarray:
    """The shift nearest to a wanted one with which no point bends its path more than it may.

    Args:
        wanted: (T, 3) metres. points: (T, P, 3) metres, paths to which the shift is added.
        limits: (T - 2,) most length of a second difference of neighbouring frames, metres; where points exceed it
            without a shift, their own length.
        pinned: (T,) bool, frames in which the shift is the wanted one.
        weights: (T,) positive. span: frames.

    Returns: (T, 3) float64, exactly `wanted` where pinned, and everywhere where that is within the limits. The
    iteration ends once the limits are met to `TOLERANCE`, or after so many rounds.
    """
    own = np.diff(points.astype(np.float64), n=2, axis=0)
    limits = np.maximum(limits[:, None], np.linalg.norm(own, axis=-1))
    bends = np.diff(wanted, n=2, axis=0)
    if len(own) == 0 or _meets(own, wanted, limits):
        return wanted
    derivative = SecondDerivative.at(np.arange(float(len(wanted))))
    count = points.shape[1]
    # As stiff as the path itself: waves then converge in as many rounds at any rate of frames.
    penalty = span**4
    bands = derivative.squared(np.full(len(own), span**4 + penalty * count))
    weights = np.where(pinned, PINNED, weights)
    bands[0] += weights
    factor = cholesky_banded(bands, lower=True)
    asked = weights[:, None] * wanted + derivative.transposed(span**4 * bends)
    shift = wanted
    held, dual = own + bends[:, None], np.zeros(own.shape)
    for iteration in range(iterations):
        if iteration % CHECK_EVERY == CHECK_EVERY - 1 and _meets(own, shift, limits):
            break
        pull = derivative.transposed(penalty * (held - dual - own).sum(1))
        shift = _PBTRS(factor, asked + pull, lower=1)[0]
        reached = RELAXATION * (own + _second_differences(shift)[:, None]) + (1 - RELAXATION) * held
        held = _within(reached + dual, limits)
        dual = dual + reached - held
    return np.where(pinned[:, None], wanted, shift)


def _meets(own: np.ndarray, shift: np.ndarray, limits: np.ndarray) -> bool:
    """Whether points with own second differences (T - 2, P, 3) and a shift (T, 3) are within limits (T - 2, P)."""
    lengths = _lengths(own + _second_differences(shift)[:, None])
    return bool((lengths <= limits * (1 + TOLERANCE)).all())


# np.diff and np.linalg.norm give the same, and take longer than the sums on a few hundred frames.
def _second_differences(values: np.ndarray) -> np.ndarray:
    """(T, F) -> (T - 2, F)."""
    steps = values[1:] - values[:-1]
    return steps[1:] - steps[:-1]


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """(..., 3) -> (...)."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.sqrt(x * x + y * y + z * z)


def _within(vectors: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Vectors (..., 3), the longer ones shortened to `most` (...)."""
    lengths = _lengths(vectors)
    return vectors * np.minimum(1.0, most / np.maximum(lengths, 1e-12))[..., None]
