"""Noise on poses: the paper's (PUMPS 5.2), and what capture does. Presets by name, each drawn from one generator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from data_schemas.errors import InputError
from stages.shared.kinematics.rotations import from_turn_vectors, multiply
from stages.shared.kinematics.swapped_sides import exchanged, joints_of

PAPER_ROOT_M = 0.1  # largest standard deviation of the root's noise
PAPER_QUATERNION = 0.2  # and of a quaternion's four values
PAPER_SHARE = (0.2, 0.8)  # of the frames
CAPTURE = "capture"
JITTER, BURSTS, DRIFT, FROZEN, LOST, SLIDE, SWAPPED = FAULTS = (
    "jitter", "bursts", "drift", "frozen", "lost", "slide", "swapped",
)  # fmt: skip


def paper_noise(
    roots: np.ndarray, local: np.ndarray, rng: np.random.Generator, limbs: Sequence[np.ndarray] = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gaussian noise on 20 to 80 % of the frames: on the root, and on all quaternion values, which are then scaled to
    length 1. The standard deviations are drawn once for a sequence, from (0, 0.1] m and (0, 0.2].

    Args:
        roots: (T, 3) metres. local: (T, J, 4) unit quaternions in the parents' frames. limbs: not used.

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
    roots: np.ndarray,
    local: np.ndarray,
    rng: np.random.Generator,
    limbs: Sequence[np.ndarray] = (),
    faults: Sequence[str] = FAULTS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What capture does to a clip at 30 frames a second: jitter of markers on all frames, bursts of noise on a joint
    and the joints after it, a joint that drifts away and comes back, a joint that freezes, a joint that is lost (its
    rotation is the identity), a pelvis that slides along the floor, and arms, legs or both whose left and right are
    exchanged. Per 128 frames, and at least once in a clip, there are one or two bursts and one of each other fault;
    the joints are drawn at random.

    Args:
        roots, local: as `paper_noise`. limbs: pairs (P, 2) of left and right joints of the arms and of the legs;
            without them nothing is exchanged. faults: of `FAULTS`; one that is left out changes no other.

    Returns: as `paper_noise`; jitter alone does not make a joint noisy. Frames and joints without a fault keep their
        numbers bit for bit if `jitter` is left out.
    """
    frames, joints = local.shape[:2]
    noisy, turned = np.zeros((frames, joints), bool), np.zeros((frames, joints), bool)
    turns, shifts = np.zeros((frames, joints, 3)), np.zeros((frames, 3))
    jitter = np.radians(rng.uniform(0.1, 0.6)) * rng.standard_normal((frames, joints, 3))
    shaken = rng.uniform(0.0005, 0.003) * rng.standard_normal(roots.shape)
    if JITTER in faults:
        turns, shifts, turned = jitter, shaken, np.ones((frames, joints), bool)
    lost = np.zeros((frames, joints), bool)
    held = np.tile(np.arange(frames)[:, None], (1, joints))
    count = max(1, round(frames / 128))

    def happens(fault: str, at: np.ndarray, joint: int) -> bool:
        if fault in faults:
            noisy[at, joint] = True
        return fault in faults

    for _ in range(count):
        for _ in range(int(rng.integers(1, 3))):
            at, joint = _stretch(frames, (3, 20), rng), int(rng.integers(joints))
            burst = rng.uniform(0.1, 0.5) * rng.standard_normal((len(at), 3))
            if happens(BURSTS, at, joint):
                turns[at, joint] += burst
                turned[at, joint] = True
        at, joint = _stretch(frames, (20, 60), rng), int(rng.integers(joints))
        shape = np.sin(np.linspace(0, np.pi, len(at))) ** 2
        drift = shape[:, None] * rng.uniform(0.1, 0.4) * rng.standard_normal(3)
        if happens(DRIFT, at, joint):
            turns[at, joint] += drift
            turned[at, joint] = True
        at, joint = _stretch(frames, (8, 30), rng), int(rng.integers(joints))
        if happens(FROZEN, at, joint):
            held[at, joint] = at[0]
        at, joint = _stretch(frames, (2, 12), rng), int(rng.integers(joints))
        if happens(LOST, at, joint):
            lost[at, joint] = True
        at = _stretch(frames, (10, 40), rng)
        slide = np.zeros(3)
        slide[[0, 2]] = rng.uniform(0.01, 0.05) * rng.standard_normal(2)
        if SLIDE in faults:
            shifts[at] += np.sin(np.linspace(0, np.pi, len(at)))[:, None] * slide
    moved = np.where(turned[..., None], multiply(np.asarray(local, np.float64), from_turn_vectors(turns)), local)
    moved = np.take_along_axis(moved, held[..., None], axis=0)
    moved = np.where(lost[..., None], [0.0, 0.0, 0.0, 1.0], moved)
    if SWAPPED in faults and limbs:  # drawn last, so that a rig without pairs gets the same other faults
        for _ in range(count):
            at, which = _stretch(frames, (5, 45), rng), int(rng.integers(len(limbs) + 1))
            chosen = list(limbs) if which == len(limbs) else [limbs[which]]
            for limb in chosen:
                moved, noisy = exchanged(moved, at, limb), exchanged(noisy, at, limb)
            noisy[at[:, None], joints_of(chosen)] = True
    return (roots + shifts).astype(roots.dtype), moved.astype(local.dtype), noisy


def swapped_noise(
    roots: np.ndarray, local: np.ndarray, rng: np.random.Generator, limbs: Sequence[np.ndarray] = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`capture_noise` with left and right exchanged and no other fault. Raises InputError for a rig without pairs."""
    check_pairs(limbs)
    return capture_noise(roots, local, rng, limbs, faults=(SWAPPED,))


def check_pairs(limbs: Sequence[np.ndarray]) -> None:
    """Raise InputError if a rig has no pairs of left and right joints to exchange."""
    if not limbs:
        raise InputError(
            "The rig has no pairs of left and right joints that could be exchanged.",
            "Take the noise capture, which has other faults too, or correct the rig's map (`pumps inspect --map`).",
        )


def _stretch(frames: int, lengths: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Frames in a row at a random place, of a length between two bounds."""
    length = min(int(rng.integers(lengths[0], lengths[1] + 1)), frames)
    return np.arange(length) + int(rng.integers(frames - length + 1))


NOISES: dict[str, Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]] = {
    "paper": paper_noise,
    CAPTURE: capture_noise,
    SWAPPED: swapped_noise,
    FROZEN: partial(capture_noise, faults=(FROZEN,)),
    LOST: partial(capture_noise, faults=(LOST,)),
}
"""Presets by name: the paper's, all faults of capture, and single faults of it."""
