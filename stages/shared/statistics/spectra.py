"""Power spectral densities of joints' velocities: how much of a motion happens how fast.

A motion that is too smooth has less power than the truth at high frequencies, one that shakes has more; both may have
the same mean error.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import periodogram

BANDS_HZ = ((0.5, 2.0), (2.0, 5.0), (5.0, 15.0))


def velocity_density(positions: np.ndarray, fps: float, bins: int = 128) -> tuple[np.ndarray, np.ndarray]:
    """One-sided power spectral density of velocities, by a periodogram with a Hann window.

    Args:
        positions: (..., T, J, 3) metres, global, `fps` frames a second. T - 1 is at most `bins`.
        bins: length of the Fourier transform, to which velocities are extended by zeros. Windows of any length then
            have the same frequencies.

    Returns:
        (bins / 2 + 1,) frequencies in Hz, and (..., bins / 2 + 1) densities in (m/s)²/Hz: the sum over axes, the mean
        over joints. The mean velocity of each joint is removed.

    Raises: ValueError for windows longer than `bins`.
    """
    velocities = np.diff(np.asarray(positions, np.float64), axis=-3) * fps
    if velocities.shape[-3] > bins:
        raise ValueError(f"a window has {velocities.shape[-3]} velocities, and the transform {bins}")
    frequencies, density = periodogram(
        velocities, fs=fps, window="hann", nfft=bins, detrend="constant", scaling="density", axis=-3
    )
    return frequencies, density.sum(axis=-1).mean(axis=-1)


def band_power(frequencies: np.ndarray, density: np.ndarray, band: tuple[float, float]) -> np.ndarray:
    """(...,) power of densities (..., F) at evenly spaced frequencies (F,) from the band's first to its last, the
    last one left out unless it is the highest of all."""
    first, last = band
    here = (frequencies >= first) & (
        (frequencies < last) | (frequencies == frequencies[-1]) & (last >= frequencies[-1])
    )
    return density[..., here].sum(axis=-1) * (frequencies[1] - frequencies[0])
