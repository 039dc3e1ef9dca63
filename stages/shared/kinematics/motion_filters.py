"""The plain filters that motion is cleaned with: Savitzky-Golay, one-euro, Butterworth, Laplacian.

They run on columns of values over time. Rotations are filtered as quaternions with continuous signs, whose components
are curves without jumps, and are scaled to length 1 afterwards. The constants below are the best of a grid on
validation clips of Bandai Namco's sets with the noise `capture` (`stages.shared.pose_tasks.noise`). `width`
multiplies the time over which a filter averages, for noise that is worse or better than that.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, savgol_filter, sosfiltfilt

from stages.shared.kinematics.rotations import continuous_signs

SAVGOL_S, SAVGOL_DEGREE = 0.3, 3
BUTTERWORTH_HZ, BUTTERWORTH_ORDER = 5.0, 2
EURO_HZ, EURO_SLOPE = 6.0, 8.0  # lowest cut-off; how much a speed of 1 a second adds to it
EURO_SPEED_HZ = 1.0
LAPLACIAN_S = 0.04  # standard deviation of the kernel that all rounds make together
_LAPLACIAN_SHARE = 0.5

Filter = Callable[[np.ndarray, float, float], np.ndarray]  # values (T, F), frames a second, width


def savgol(values: np.ndarray, fps: float, width: float = 1.0) -> np.ndarray:
    """A polynomial of degree 3 fitted around each frame (Savitzky and Golay 1964), by SciPy; values (T, F)."""
    window = max(SAVGOL_DEGREE + 2, round(width * SAVGOL_S * fps) | 1)
    window = min(window, len(values) - 1 + len(values) % 2)
    if window <= SAVGOL_DEGREE:
        return values.copy()
    return np.asarray(savgol_filter(values, window, SAVGOL_DEGREE, axis=0))


def butterworth(values: np.ndarray, fps: float, width: float = 1.0) -> np.ndarray:
    """Butterworth's low-pass of order 2, run forwards and backwards, so that nothing is delayed, by SciPy."""
    cutoff_hz = BUTTERWORTH_HZ / width
    if cutoff_hz >= fps / 2 or len(values) < 4:
        return values.copy()
    sections = butter(BUTTERWORTH_ORDER, cutoff_hz, fs=fps, output="sos")
    return sosfiltfilt(sections, values, axis=0, padlen=min(len(values) - 1, int(3 * fps / cutoff_hz)))


def one_euro(values: np.ndarray, fps: float, width: float = 1.0) -> np.ndarray:
    """The one-euro filter (Casiez, Roussel, Vogel 2012): a low-pass whose cut-off rises with speed. It looks only
    backwards, so that fast movements are delayed a little; it is offered since it is what live capture uses."""
    out = np.array(values, np.float64)
    speed = np.zeros(values.shape[1:])
    of_speed = _smoothing(np.asarray(EURO_SPEED_HZ), fps)
    for frame in range(1, len(values)):
        speed += of_speed * ((values[frame] - out[frame - 1]) * fps - speed)
        share = _smoothing((EURO_HZ + EURO_SLOPE * np.abs(speed)) / width, fps)
        out[frame] = out[frame - 1] + share * (values[frame] - out[frame - 1])
    return out


def laplacian(values: np.ndarray, fps: float, width: float = 1.0) -> np.ndarray:
    """Laplacian smoothing (Sorkine 2004, in time): frames move half-way to the mean of their neighbours, round by
    round; the first and last frame stay. The rounds together are nearly a Gaussian."""
    out = np.array(values, np.float64)
    for _ in range(max(1, round((width * LAPLACIAN_S * fps) ** 2 / _LAPLACIAN_SHARE))):
        out[1:-1] += _LAPLACIAN_SHARE * ((out[:-2] + out[2:]) / 2 - out[1:-1])
    return out


FILTERS: dict[str, Filter] = {
    "savgol": savgol,
    "one-euro": one_euro,
    "butterworth": butterworth,
    "laplacian": laplacian,
}


def filter_rotations(rotations: np.ndarray, fps: float, chosen: Filter, width: float = 1.0) -> np.ndarray:
    """Unit quaternions (T, J, 4) filtered by components, signs made continuous first; (T, J, 4) float64."""
    curves = continuous_signs(np.asarray(rotations, np.float64))
    made = chosen(curves.reshape(len(curves), -1), fps, width).reshape(curves.shape)
    lengths = np.linalg.norm(made, axis=-1, keepdims=True)
    return np.where(lengths > 1e-6, made / np.maximum(lengths, 1e-6), curves)


def _smoothing(cutoff_hz: np.ndarray, fps: float) -> np.ndarray:
    """The share of a new value in an exponential average with this cut-off."""
    turn = 2 * np.pi * cutoff_hz / fps
    return turn / (turn + 1)
