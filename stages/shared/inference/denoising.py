"""Clean a motion on its own skeleton: put exchanged sides back, mend what is noisy or missing, or run a filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.symmetric_pairs import pairs_of_limbs
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.models import Models
from stages.shared.kinematics.forward_numpy import global_rotations, local_rotations_of
from stages.shared.kinematics.motion_filters import FILTERS, filter_rotations
from stages.shared.kinematics.rotations import aligned_signs, angles_between, continuous_signs, slerp
from stages.shared.kinematics.runs import runs_of
from stages.shared.solve.robust_smoothing import mend_poses

LONG_GAP_S = 0.3  # a stretch without a usable frame that is longer than this is filled by the models
_CHANGED = 1e-6  # quaternions and metres: less is rounding
MENDING = ("mend", "latent")  # methods that find what is noisy; the others filter all frames
_LEAST_KNOWN = 2  # frames between which the models fill


@dataclass(frozen=True)
class Denoised:
    """A cleaned motion.

    noisy:   (T, J) True where a joint was found noisy or was missing (for a plain filter: was missing).
    filled:  (T,) frames that the models filled.
    swapped: (T, J) True where a joint got the rotation of its partner on the other side.
    changed: (T, J) True where a joint's local rotation changed. moved: (T,) True where a position did.
    turned_deg: (T, J) by how much a joint turned, degrees. shifted_m: (T,) by how much joint 0 or a track moved.
    """

    motion: Motion
    noisy: np.ndarray
    filled: np.ndarray
    swapped: np.ndarray
    changed: np.ndarray
    moved: np.ndarray
    turned_deg: np.ndarray
    shifted_m: np.ndarray


@dataclass(frozen=True)
class DenoiseOptions:
    """method: "mend", "latent" (mending, then `refine`), or a name of `FILTERS`. width: of a filter. strength: 0 to
    1. seed: of the filling."""

    method: str = "mend"
    width: float = 1.0
    strength: float = 1.0
    seed: int = 0


def denoise_motion(
    skeleton: Skeleton,
    motion: Motion,
    missing: np.ndarray,
    *,
    options: DenoiseOptions | None = None,
    models: Callable[[], Models] | None = None,
    refine: Callable[[Motion, Motion], Motion] | None = None,
    frames: np.ndarray | None = None,
    joints: np.ndarray | None = None,
    positions: bool = True,
) -> Denoised:
    """Clean a motion of any length, in time linear in it.

    Args:
        motion: T frames at any rate; values that are missing are not read.
        missing: (T, J) True where a joint's rotation is not there; a frame with none is missing as a whole.
        models: loads the models that fill long stretches without a usable frame; None interpolates them.
        refine: makes another motion of the noisy motion and the mended one, such as a network of the rig.
        frames: (T,) True for the frames to clean, joints: (J,) for the joints, positions: whether positions are
            cleaned. What is missing is filled everywhere.
    """
    options = options or DenoiseOptions()
    local = local_rotations_of(skeleton, motion)
    places = positions_in(motion)
    gone = np.asarray(missing.all(axis=1))
    filled = np.zeros(motion.frames, bool)
    noisy = missing.copy()
    swapped = np.zeros_like(missing)
    start_local, start_places = (local, places)
    every, each = np.ones(motion.frames, bool), np.ones(skeleton.joints, bool)
    each = each if joints is None else joints
    asked = (every if frames is None else frames)[:, None] & each
    if options.method in MENDING or missing.any():
        limbs = pairs_of_limbs(skeleton.names, skeleton.parents, skeleton.offsets, skeleton.groups)
        # A limb is put back as a whole or not at all.
        limbs = [limb for limb in limbs if options.method in MENDING and options.strength and each[limb].all()]
        mended = mend_poses(local, places, missing, limbs)
        if options.method in MENDING:
            noisy, swapped = mended.noisy, mended.swapped & asked
            start_local, start_places = mended.local, mended.positions
            unusable = mended.frames
        else:
            start_local = np.where(missing[..., None], mended.local, local)
            start_places = np.where(gone[:, None], mended.positions, places)
            unusable = gone
        filled = long_stretches(unusable, LONG_GAP_S * motion.fps)
        if models is not None and filled.any() and (~filled).sum() >= _LEAST_KNOWN:
            whole = motion_from(skeleton, motion, start_local, start_places)
            loaded = models()
            made = fill_motion(
                skeleton, whole, ~filled, SynthesisedClouds(loaded), seed=options.seed,
                device=loaded.autoencoder.device, options=FillOptions(foot_lock=True),
            ).motion  # fmt: skip
            start_local = np.where(filled[:, None, None], local_rotations_of(skeleton, made), start_local)
            start_places = np.where(filled[:, None], positions_in(made), start_places)
        else:
            filled[:] = False
    if options.method not in MENDING:
        chosen = FILTERS[options.method]
        start_local = filter_rotations(start_local, motion.fps, chosen, options.width)
        start_places = chosen(np.asarray(start_places, np.float64), motion.fps, options.width)
    if refine is not None:
        known = np.where(missing[..., None], start_local, local)
        made = refine(
            motion_from(skeleton, motion, known, np.where(gone[:, None], start_places, places)),
            motion_from(skeleton, motion, start_local, start_places),
        )
        start_local, start_places = local_rotations_of(skeleton, made), positions_in(made)
    share = np.where(missing | swapped, 1.0, options.strength * asked)
    made_local = slerp(local, aligned_signs(start_local, local), share[..., None])
    made_local = np.where(missing[..., None], start_local, np.where(share[..., None] > 0, made_local, local))
    share = np.where(gone, 1.0, options.strength * np.asarray(asked.any(axis=1)) * positions)[:, None]
    made_places = np.where(gone[:, None], start_places, places + share * (start_places - places))
    return _compared(skeleton, motion, local, places, made_local, made_places, missing, gone, noisy, filled, swapped)


def _compared(
    skeleton: Skeleton,
    motion: Motion,
    local: np.ndarray,
    places: np.ndarray,
    made_local: np.ndarray,
    made_places: np.ndarray,
    missing: np.ndarray,
    gone: np.ndarray,
    noisy: np.ndarray,
    filled: np.ndarray,
    swapped: np.ndarray,
) -> Denoised:
    apart_rad = angles_between(made_local, local)
    turned = np.degrees(apart_rad)
    apart = (made_places - places).reshape(len(places), -1, 3)
    shifted = np.linalg.norm(apart, axis=-1).max(-1)
    changed = (apart_rad > 2 * _CHANGED) | missing
    moved = (shifted > _CHANGED) | gone
    return Denoised(
        motion_from(skeleton, motion, made_local, made_places),
        noisy, filled, swapped, changed, moved,
        np.where(missing, 0.0, turned), np.where(gone, 0.0, shifted),
    )  # fmt: skip


def positions_in(motion: Motion) -> np.ndarray:
    """(T, 3 + 3 K) float64: joint 0's position and the tracks, metres."""
    tracks = motion.tracks.reshape(motion.frames, -1)
    return np.concatenate([motion.root_positions, tracks], axis=1).astype(np.float64)


def motion_from(skeleton: Skeleton, like: Motion, local: np.ndarray, positions: np.ndarray) -> Motion:
    """A motion of local rotations (T, J, 4) and positions as `positions_in` has them, with the tracks of another."""
    rotations = global_rotations(local, skeleton.parents)
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    tracks = positions[:, 3:].reshape(len(local), len(like.track_joints), 3).astype(np.float32)
    return replace(
        like,
        rotations=continuous_signs(rotations).astype(np.float32),
        root_positions=positions[:, :3].astype(np.float32),
        tracks=tracks,
    )


def long_stretches(unusable: np.ndarray, longer_than: float) -> np.ndarray:
    """(T,) True in runs of unusable frames that are longer than a number of frames."""
    long = np.zeros(len(unusable), bool)
    for run in runs_of(unusable):
        long[run] = len(run) > longer_than
    return long
