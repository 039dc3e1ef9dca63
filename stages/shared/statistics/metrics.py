"""The figures, as pure functions (definitions in docs/evaluation.md).

Every function takes NumPy arrays with any leading window dimensions `...` and gives one number per window. Positions
are (..., T, J, 3) metres and quaternions (..., T, J, 4) unit xyzw, both global. All frames count; an exact keyframe
counts as zero. Sums run in float64.
"""

from __future__ import annotations

import numpy as np

from stages.shared.kinematics.rotations import aligned_signs, angles_between

MILLIMETRES = 1000.0


def l2p_m(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """L2P: the norm over all joints and axes of a frame's position error, mean over frames; (...,) metres."""
    difference = _difference(predicted, true)
    return np.sqrt((difference**2).sum(axis=(-2, -1))).mean(axis=-1)


def l2q(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """L2Q: the same norm on unit quaternions, each prediction given the sign nearer to the truth; (...,)."""
    difference = _difference(aligned_signs(predicted, true), true)
    return np.sqrt((difference**2).sum(axis=(-2, -1))).mean(axis=-1)


def mpjpe_mm(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Mean distance of a joint from its true position; (...,) millimetres."""
    return _mean_norm(_difference(predicted, true))


def mpjve_mm(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Mean norm of the error of first differences in time; (...,) millimetres a frame."""
    return _mean_norm(np.diff(_difference(predicted, true), axis=-3))


def acceleration_mm(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Mean norm of the error of second differences in time; (...,) millimetres a frame squared."""
    return _mean_norm(np.diff(_difference(predicted, true), n=2, axis=-3))


def mpjae_deg(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Mean angle of the rotation between predicted and true joint rotations (geodesic); (...,) degrees."""
    return np.degrees(angles_between(predicted, true)).mean(axis=(-2, -1))


def npss(predicted: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normalised power spectrum similarity of features (..., T, F), on the power |FFT|^2 of all T frequencies.

    For each feature: the L1 distance between the cumulative sums of the two normalised power spectra; then the mean
    over features, weighted by the truth's power. A feature with no power at all counts as a constant.

    Returns: (...,) values, and (...,) weights: the truth's power, by which windows are averaged.
    """
    p, q = _half_spectrum(predicted), _half_spectrum(true)
    frames = true.shape[-2]
    return _spectral_distance(_mirrored(np.abs(p) ** 2, frames), _mirrored(np.abs(q) ** 2, frames))


def npss_lafan1(predicted: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """NPSS as LaFAN1's benchmark computes it: only the real part of the spectrum is squared.

    The power then depends on the phase, so its figures cannot be compared with `npss`.
    """
    p, q = _half_spectrum(predicted), _half_spectrum(true)
    frames = true.shape[-2]
    return _spectral_distance(_mirrored(np.real(p) ** 2, frames), _mirrored(np.real(q) ** 2, frames))


def l2p_lafan1(predicted: np.ndarray, true: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """LaFAN1's L2P: positions divided by the training set's deviation (J, 3) of each joint and axis; no unit.

    Pass only the missing frames: that benchmark leaves the keyframes out.
    """
    return l2p_m(predicted / deviation, true / deviation)


def l2q_lafan1(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """LaFAN1's L2Q: signs made continuous in time but not aligned to the truth, missing frames alone; (...,)."""
    difference = _difference(predicted, true)
    return np.sqrt((difference**2).sum(axis=(-2, -1))).mean(axis=-1)


def pose_features(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """All components of positions and quaternions as features, (..., T, J * 7)."""
    flat = [part.reshape(*part.shape[:-2], -1) for part in (positions, quaternions)]
    return np.concatenate(flat, axis=-1)


def _difference(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    return np.asarray(predicted, np.float64) - np.asarray(true, np.float64)


def _mean_norm(difference_m: np.ndarray) -> np.ndarray:
    return MILLIMETRES * np.linalg.norm(difference_m, axis=-1).mean(axis=(-2, -1))


def _half_spectrum(features: np.ndarray) -> np.ndarray:
    return np.fft.rfft(np.asarray(features, np.float64), axis=-2)


def _mirrored(power: np.ndarray, frames: int) -> np.ndarray:
    """Power at all `frames` frequencies from that at the lower half: the spectrum of a real signal is symmetric."""
    return np.concatenate([power, power[..., 1 : frames - power.shape[-2] + 1, :][..., ::-1, :]], axis=-2)


def _spectral_distance(predicted_power: np.ndarray, true_power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    cumulative = [_shares(power).cumsum(axis=-2) for power in (predicted_power, true_power)]
    distance = np.abs(cumulative[0] - cumulative[1]).sum(axis=-2)
    weight = true_power.sum(axis=-2)
    total = weight.sum(axis=-1)
    return (distance * weight).sum(axis=-1) / np.maximum(total, np.finfo(np.float64).tiny), total


def _shares(power: np.ndarray) -> np.ndarray:
    """Each frequency's share of a feature's power; without power, all of it is at frequency zero (a constant)."""
    total = power.sum(axis=-2, keepdims=True)
    constant = np.zeros_like(power)
    constant[..., 0, :] = 1.0
    return np.where(total > 0, power / np.where(total > 0, total, 1.0), constant)
