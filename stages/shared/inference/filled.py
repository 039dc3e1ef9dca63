"""A filled motion, and what a summary should say of it: velocity at the keys, feet that slide."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion
from stages.shared.inference.standing_feet import standing_feet
from stages.shared.kinematics.foot_contacts import find_feet, foot_skate_mps
from stages.shared.solve.skeleton_pose import SkeletonPose


@dataclass(frozen=True)
class Filled:
    """A filled motion and what a summary should say of it.

    motion:         as many frames as were given, at the same rate; keys are the given rows, value for value.
    plain:          (T, J) bool, True where a frame that is not a key has the plain interpolation's local rotation,
                    before smoothing, easing out of the keys and foot lock.
    jump_frames:    (K,) keys that border a gap and have frames on both sides.
    jumps_mps:      (K,) mean change of the body joints' velocity at these keys, metres a second.
    base_jumps_mps: (K,) the same of the plain interpolation.
    skate_mps:      mean horizontal speed of the feet, metres a second, while those of the filled motion stand
                    (`standing_feet`, before they were held); NaN where none does.
    base_skate_mps: the same of the plain interpolation, in the same frames.
    loose_skate_mps: the same of the filled motion before its feet were held; `skate_mps` where they were not.
    longest_gap_s:  longest time between two neighbouring keys, or between a key and an end of the clip.
    wander_m:       how far decoded points stray in the frames of the bones that they ride on, metres (median): the
                    autoencoder's own error on this rig, large where the rig is strange to it.
    pins_off_m:     pinned end -> how far it is from its place at most, metres.
    """

    motion: Motion
    plain: np.ndarray
    jump_frames: np.ndarray
    jumps_mps: np.ndarray
    base_jumps_mps: np.ndarray
    skate_mps: float
    base_skate_mps: float
    loose_skate_mps: float
    longest_gap_s: float
    wander_m: float
    pins_off_m: dict[str, float] = field(default_factory=dict)


def nothing_to_fill(motion: Motion) -> Filled:
    """What is said of a motion whose every frame is known."""
    none, nan = np.zeros(0), float("nan")
    plain = np.zeros(motion.rotations.shape[:2], bool)
    return Filled(motion, plain, none.astype(np.int64), none, none, nan, nan, nan, 1 / motion.fps, 0.0)


def measured_fill(
    known: np.ndarray,
    fps: float,
    pose: SkeletonPose,
    plain: np.ndarray,
    *,
    loose: SkeletonPose,
    base: SkeletonPose,
    wander_m: float,
) -> Filled:
    """Measure a fill, and give its pose back as a motion.

    Args:
        known: (T,) bool. plain: (T, J) bool and wander_m, as `Filled` has them.
        pose: the filled clip. loose: the same before its feet were held. base: the plain interpolation.
    """
    keys = np.flatnonzero(known)
    jump_frames = keys_at_gaps(known)
    skate, base_skate, loose_skate = skates(loose, known, fps, pose, base, loose)
    return Filled(
        pose.motion(fps),
        plain,
        jump_frames,
        velocity_jumps(pose, jump_frames, fps),
        velocity_jumps(base, jump_frames, fps),
        skate,
        base_skate,
        loose_skate,
        float(np.diff(np.concatenate([[0], keys, [len(known) - 1]])).max() / fps),
        wander_m,
    )


def keys_at_gaps(known: np.ndarray) -> np.ndarray:
    """(K,) known frames, not the first or last, beside one that is not known."""
    return np.flatnonzero(known[1:-1] & ~(known[2:] & known[:-2])) + 1


def velocity_jumps(pose: SkeletonPose, frames: np.ndarray, fps: float) -> np.ndarray:
    """(K,) mean over the body's joints of |velocity after - before| at inner frames (K,), metres a second."""
    rows = pose.rows((frames[:, None] + np.array([-1, 0, 1])).ravel()).by_local()
    heads = rows.heads[:, torch.as_tensor(pose.skeleton.groups >= 0)].unflatten(0, (-1, 3))
    change = heads[:, 2] - 2 * heads[:, 1] + heads[:, 0]
    return (change.norm(dim=-1).mean(-1) * fps).numpy()


def skates(standing: SkeletonPose, known: np.ndarray, fps: float, *poses: SkeletonPose) -> list[float]:
    """Foot skate of several poses, metres a second, while the feet of `standing` stand; NaN where none does."""
    try:
        feet = find_feet(standing.skeleton)
    except InputError:
        return [float("nan")] * len(poses)
    contacts = standing_feet(standing.heads.numpy(), feet, fps, known)
    return [foot_skate_mps(pose.heads.numpy(), contacts, feet, fps) for pose in poses]
