"""A motion of which all that is not known is interpolated plainly: slerp of rotations, straight lines of places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.forward import global_rotations, local_rotations, offsets_over_time
from stages.shared.kinematics.plain_interpolation import interpolate_pose


def plain_motion(skeleton: Skeleton, motion: Motion, joints: np.ndarray, position: np.ndarray) -> Motion:
    """The motion between what is known of T frames; before the first and after the last known frame poses are held.

    Args:
        joints: (T, J) bool, where a joint's rotation is known. position: (T,) bool, where the pelvis' place is known.
            Each has a known frame at least.
    """
    local = local_rotations(torch.as_tensor(motion.rotations), skeleton.parents)
    roots = torch.as_tensor(motion.root_positions)
    offsets = offsets_over_time(skeleton, motion)
    moving = offsets.dim() == 3
    local_out, offsets_out = local.clone(), offsets.clone()
    times = torch.arange(motion.frames, dtype=torch.float64)

    def between(known: np.ndarray, chosen: np.ndarray) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        keys = torch.as_tensor(np.flatnonzero(known))
        at_keys = offsets[keys][:, chosen] if moving else offsets[chosen]
        return interpolate_pose(local[keys][:, chosen], roots[keys], at_keys, keys.double(), times)

    patterns, pattern_of = np.unique(joints, axis=1, return_inverse=True)
    for number, known in enumerate(patterns.T):
        chosen = np.flatnonzero(pattern_of.reshape(-1) == number)
        local_out[:, chosen], _, turned = between(known, chosen)
        if moving:
            offsets_out[:, chosen] = turned
    _, roots_out, of_pelvis = between(position, np.array([skeleton.root]))
    if moving:
        offsets_out[:, [skeleton.root]] = of_pelvis
    return replace(
        motion,
        rotations=global_rotations(local_out, skeleton.parents).numpy(),
        root_positions=roots_out.numpy(),
        tracks=offsets_out[:, motion.track_joints].numpy() if moving else motion.tracks,
    )
