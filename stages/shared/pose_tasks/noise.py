"""Noise on poses: the paper's (PUMPS 5.2), and what capture does. Presets by name, each drawn from one generator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

PAPER_ROOT_M = 0.1  # largest standard deviation of the root's noise
PAPER_QUATERNION = 0.2  # and of a quaternion's four values
PAPER_SHARE = (0.2, 0.8)  # of the frames


def paper_noise(
    roots: np.ndarray, local: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gaussian noise on 20 to 80 % of the frames: on the root, and on all quaternion values, which are then scaled to
    length 1. The standard deviations are drawn once for a sequence, from (0, 0.1] m and (0, 0.2].

    Args:
        roots: (T, 3) metres. local: (T, J, 4) unit quaternions in the parents' frames.

    Returns: noisy roots, noisy local rotations, and (T, J) True where a joint is noisy; of the inputs' dtypes.
    """
    frames = len(roots)
    noisy = np.zeros(frames, bool)
    count = max(1, round(frames * rng.uniform(*PAPER_SHARE)))
    noisy[rng.permutation(frames)[:count]] = True
    root_std, quaternion_std = PAPER_ROOT_M * (1 - rng.random()), PAPER_QUATERNION * (1 - rng.random())
    roots = roots + np.where(noisy[:, None], root_std * rng.standard_normal(roots.shape), 0).astype(roots.dtype)
    moved = local + quaternion_std * rng.standard_normal(local.shape).astype(local.dtype)
    moved /= np.linalg.norm(moved, axis=-1, keepdims=True)
    local = np.where(noisy[:, None, None], moved, local)
    return roots, local, np.broadcast_to(noisy[:, None], local.shape[:2]).copy()


NOISES: dict[str, Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]] = {"paper": paper_noise}
