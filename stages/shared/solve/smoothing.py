"""Smooth a solved motion in time without moving its keys (Whittaker's smoother on uneven times)."""

from __future__ import annotations

import numpy as np
from scipy.fft import dct, idct
from torch import Tensor

from stages.shared.kinematics.frame_blocks import in_blocks
from stages.shared.kinematics.rotations import turns_between
from stages.shared.solve.bending import SecondDerivative, solve_bands

PINNED = 1e9  # weight of a value that must not move, against 1 for the others
SPANS = (0.2, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)


def smooth_corrections(
    values: np.ndarray,
    bends: np.ndarray,
    times: np.ndarray,
    pinned: np.ndarray,
    span: float,
    weights: np.ndarray | None = None,
) -> np.ndarray:
    """Corrections that stay near `values` and make the motion's acceleration, base included, small.

    Minimises the sum over time of |c - values|^2 + span^4 |c'' + bends|^2: waves shorter than about
    2 pi span are flattened, slower ones stay.

    Args:
        values: (N, F) solved corrections.
        bends: (N, F) second time derivative of the base that they are added to, in units per time^2.
        times: (N,) strictly rising.
        pinned: (N,) True where the correction is zero and stays so.
        span: in units of the times; 0 gives `values` back.
        weights: (N,) weight of each value; by default the time that it represents.

    Returns: (N, F) float64, exactly zero where pinned.
    """
    values = np.where(pinned[:, None], 0.0, values)
    if span <= 0 or len(times) < 3:
        return values
    h = np.diff(times)
    derivative = SecondDerivative.at(times)
    stiff = span**4 * derivative.width
    own = np.concatenate([h[:1] / 2, derivative.width, h[-1:] / 2])
    weight = np.where(pinned, PINNED, own if weights is None else weights)
    bands = derivative.squared(stiff)
    bands[0] += weight
    wanted = weight[:, None] * values - derivative.transposed(stiff[:, None] * bends[1:-1])
    return np.where(pinned[:, None], 0.0, solve_bands(bands, wanted))


def bends_of_rotations(rotations: Tensor, times: np.ndarray) -> np.ndarray:
    """Angular acceleration (N, J, 3) of rotations (N, J, 4) in their own axes; zeros at both ends."""
    turns = in_blocks(turns_between, rotations[:-1], rotations[1:])
    return _rates_to_bends(turns.double().numpy(force=True), times)


def bends_of_positions(positions: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Acceleration (N, ...) of values (N, ...); zeros at both ends."""
    return _rates_to_bends(np.diff(positions, axis=0), times)


def _rates_to_bends(steps: np.ndarray, times: np.ndarray) -> np.ndarray:
    h = np.diff(times).reshape(-1, *[1] * (steps.ndim - 1))
    rates = steps / h
    bends = np.zeros((len(steps) + 1, *steps.shape[1:]))
    bends[1:-1] = np.diff(rates, axis=0) / ((h[1:] + h[:-1]) / 2)
    return bends


def smooth_as_needed(curves: np.ndarray, *, together: int = 3) -> np.ndarray:
    """Curves smoothed with the strength that best predicts frames that are left out.

    The strength is found by generalised cross-validation (Craven and Wahba 1979): on evenly spaced frames Whittaker's
    smoother is diagonal in the cosine transform (Garcia 2010), so that trying all of `SPANS` costs one transform.
    Noise that is independent in every frame is removed; a drift is not.

    Args:
        curves: (N, F) at frames 1 apart, N >= 3.
        together: number of neighbouring columns, a joint's axes, that are smoothed with the same strength.

    Returns: (N, F) float64.
    """
    frames = len(curves)
    ramp = np.linspace(0, 1, frames)[:, None]
    line = (1 - ramp) * curves[:1] + ramp * curves[-1:]
    waves = np.asarray(dct(curves - line, axis=0, norm="ortho"))
    power = (waves**2).reshape(frames, -1, together).sum(-1)
    roughness = (2 - 2 * np.cos(np.pi * np.arange(frames) / frames)) ** 2
    kept = 1 / (1 + np.array(SPANS)[:, None] ** 4 * roughness)  # (S, N) of each wave
    scores = ((1 - kept) ** 2 @ power) / ((1 - kept).sum(1, keepdims=True) ** 2)
    best = np.repeat(scores.argmin(0), together)
    return np.asarray(idct(waves * kept[best].T, axis=0, norm="ortho")) + line
