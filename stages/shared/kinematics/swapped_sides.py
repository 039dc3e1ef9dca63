"""Left and right limbs that are exchanged for a stretch of frames: how that looks, how it is found, and undone.

The joints of the two limbs exchange their rotations in their parents' frames. Where the limbs begin at one joint, or
at joints that are exchanged too, their rotations in the world are exchanged by that.

An exchange is found at its two ends. There both limbs jump, and each goes on where the other was: the motion before
and after such a seam fits together far better with left and right exchanged. Between seams an exchanged limb moves as
smoothly as any other. Which stretches are the exchanged ones follows from the seams if they are as short as possible.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter

from stages.shared.kinematics.rotations import continuous_signs

_LEAST = 0.06  # of a jump, in quaternions of all joints of both limbs, roots of sums of squares
_JUMP = 3.0  # times the usual misfit of frames near it
_AROUND = 31  # frames, over which the usual misfit is taken
_FITS = 0.6  # of a jump: what may be left of it with left and right exchanged
_PER_SEAM, _PER_FRAME = 0.02, 0.0002  # costs in the same unit, so that stretches are few and short


def exchanged(local: np.ndarray, at: np.ndarray, limb: np.ndarray) -> np.ndarray:
    """Values (T, J, ...) with the joints of a limb exchanged with those of the other side in some frames.

    Args:
        at: (T,) bool or indices of frames. limb: (P, 2) pairs of left and right joints.
    """
    out = local.copy()
    left, right = limb.T
    rows = np.flatnonzero(at) if at.dtype == bool else at
    out[rows[:, None], left], out[rows[:, None], right] = local[rows[:, None], right], local[rows[:, None], left]
    return out


def joints_of(limbs: Sequence[np.ndarray]) -> np.ndarray:
    """The joints of both sides of limbs, in rising order."""
    return np.unique(np.concatenate([limb.ravel() for limb in limbs])) if limbs else np.zeros(0, np.int64)


def exchanged_frames(local: np.ndarray, limb: np.ndarray) -> np.ndarray:
    """Frames in which a limb is exchanged with that of the other side.

    Args:
        local: (T, J, 4) unit quaternions in the parents' frames. limb: (P, 2) pairs of left and right joints.

    Returns: (T,) bool; all False without a seam that no motion explains. Of a clip in two parts of which one is
        exchanged, the shorter part.
    """
    if len(local) < 4:
        return np.zeros(len(local), bool)
    same, across = _misfits(local, limb)
    usual = median_filter(same, size=min(_AROUND, 2 * len(same) - 1), mode="nearest")
    seams = (same > np.maximum(_LEAST, _JUMP * usual)) & (across < _FITS * same)
    if not seams.any():
        return np.zeros(len(local), bool)
    # Limbs that lie alike may be exchanged without a jump: at a price, a stretch may begin or end there too.
    return _cheapest(np.where(seams, across - same, np.maximum(across - same, 0)) + _PER_SEAM)


def _misfits(local: np.ndarray, limb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T,) how badly the motion up to the frame before meets the motion from each frame on, halfway between the two,
    each limb with itself and with the other; 0 for frame 0."""
    sides = [continuous_signs(np.asarray(local[:, joints], np.float64)) for joints in limb.T]
    ends = []  # of each limb: the motion before each seam, and after it, continued to the seam
    for values in sides:
        half = np.zeros_like(values)
        half[1:] = (values[1:] - values[:-1]) / 2
        after = values.copy()
        after[:-1] -= half[1:]
        ends.append(((values + half)[:-1], after[1:]))
    found = []
    for partner in (0, 1):
        squares = [_nearest_squares(ends[side][0], ends[side ^ partner][1]) for side in (0, 1)]
        found.append(np.concatenate([[0.0], np.sqrt((squares[0] + squares[1]).sum(axis=1))]))
    return found[0], found[1]


def _nearest_squares(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Squared distances of quaternions (..., 4), of either sign."""
    return np.minimum(((first - second) ** 2).sum(-1), ((first + second) ** 2).sum(-1))


def _cheapest(costs: np.ndarray) -> np.ndarray:
    """(T,) the state, False or True, of each frame, where a change before a frame costs (T,) and each frame in True a
    little: Viterbi's algorithm with two states."""
    came = np.zeros((len(costs), 2), bool)  # from the other state
    plain, other = 0.0, _PER_FRAME
    for frame in range(1, len(costs)):
        cost = float(costs[frame])
        came[frame] = other + cost < plain, plain + cost < other
        plain, other = min(plain, other + cost), min(other, plain + cost) + _PER_FRAME
    found = np.zeros(len(costs), bool)
    state = int(other < plain)
    for frame in range(len(costs) - 1, -1, -1):
        found[frame] = bool(state)
        if came[frame, state]:
            state = 1 - state
    return found
