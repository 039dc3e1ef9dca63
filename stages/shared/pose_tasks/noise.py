"""Noise on poses: the paper's (PUMPS 5.2), and what capture does. Presets by name, each drawn from one generator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stages.shared.kinematics.rotations import from_turn_vectors, multiply

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


def capture_noise(
    roots: np.ndarray, local: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What capture does to a clip at 30 frames a second: jitter of markers on all frames, bursts of noise on a joint
    and the joints after it, a joint that drifts away and comes back, a joint that freezes, a joint that is lost (its
    rotation is the identity), a pelvis that slides along the floor. Per 128 frames, and at least once in a clip,
    there are one or two bursts and one of each other fault; the joints are drawn at random.

    Args and returns: as `paper_noise`; jitter alone does not make a joint noisy.
    """
    frames, joints = local.shape[:2]
    noisy = np.zeros((frames, joints), bool)
    turns = np.radians(rng.uniform(0.1, 0.6)) * rng.standard_normal((frames, joints, 3))
    roots = roots + rng.uniform(0.0005, 0.003) * rng.standard_normal(roots.shape)
    lost = np.zeros((frames, joints), bool)
    held = np.tile(np.arange(frames)[:, None], (1, joints))
    for _ in range(max(1, round(frames / 128))):
        for _ in range(int(rng.integers(1, 3))):  # bursts
            at, joint = _stretch(frames, (3, 20), rng), int(rng.integers(joints))
            turns[at, joint] += rng.uniform(0.1, 0.5) * rng.standard_normal((len(at), 3))
            noisy[at, joint] = True
        at, joint = _stretch(frames, (20, 60), rng), int(rng.integers(joints))  # a drift
        shape = np.sin(np.linspace(0, np.pi, len(at))) ** 2
        turns[at, joint] += shape[:, None] * rng.uniform(0.1, 0.4) * rng.standard_normal(3)
        noisy[at, joint] = True
        at, joint = _stretch(frames, (8, 30), rng), int(rng.integers(joints))  # a frozen joint
        held[at, joint] = at[0]
        noisy[at, joint] = True
        at, joint = _stretch(frames, (2, 12), rng), int(rng.integers(joints))  # a lost joint
        lost[at, joint] = noisy[at, joint] = True
        at = _stretch(frames, (10, 40), rng)  # a slide of the pelvis
        slide = np.zeros(3)
        slide[[0, 2]] = rng.uniform(0.01, 0.05) * rng.standard_normal(2)
        roots[at] += np.sin(np.linspace(0, np.pi, len(at)))[:, None] * slide
    moved = multiply(np.asarray(local, np.float64), from_turn_vectors(turns))
    moved = np.take_along_axis(moved, held[..., None], axis=0)
    moved = np.where(lost[..., None], [0.0, 0.0, 0.0, 1.0], moved)
    return roots.astype(np.float32), moved.astype(np.float32), noisy


def _stretch(frames: int, lengths: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Frames in a row at a random place, of a length between two bounds."""
    length = min(int(rng.integers(lengths[0], lengths[1] + 1)), frames)
    return np.arange(length) + int(rng.integers(frames - length + 1))


NOISES: dict[str, Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]] = {
    "paper": paper_noise,
    "capture": capture_noise,
}
