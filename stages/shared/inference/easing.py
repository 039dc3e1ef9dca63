"""Motion that leaves a key as it reached it: what a gap's velocity lacks at a key is lent to its first frames.

Plain interpolation of a long gap keeps little of the keys' velocity, since nothing is known of the middle. Right
beside a key much is: bodies do not stop dead. So the difference of the velocities on both sides of a key is added as
an offset that starts with that slope and dies away, and with it the kink; the keys and the rest of the gap stay.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.frame_blocks import in_blocks
from stages.shared.kinematics.rotations import from_turn_vectors, multiply, turns_between
from stages.shared.solve.skeleton_pose import SkeletonPose

VELOCITY_S = 1 / 30  # over which the velocity on a key's known side is taken, against the noise of single frames


def ease_at_keys(
    pose: SkeletonPose, known: np.ndarray, fps: float, span_s: float, behind_s: float = VELOCITY_S
) -> SkeletonPose:
    """A filled pose without kinks at its keys.

    Where the frames before or after a key are known, the gap takes over their velocity; at a lone key both gaps give
    way by half.

    Args:
        pose: all T frames of a clip. known: (T,) bool; known frames come back value for value.
        span_s: how long an offset lasts, seconds; in shorter gaps as long as the gap. 0 changes nothing.
        behind_s: time over which the velocity on a key's known side is taken, a frame at least.
    """
    if span_s <= 0:
        return pose
    curves = [in_blocks(turns_between, pose.local[:-1], pose.local[1:]), pose.roots.diff(dim=0)]
    if pose.moves:
        curves.append(pose.offsets.diff(dim=0))
    added = [torch.zeros(len(known), *steps.shape[1:], dtype=steps.dtype, device=steps.device) for steps in curves]
    behind = max(round(behind_s * fps), 1)
    for key, side in _gap_edges(known):
        frames = _gap_frames(known, key, side, round(span_s * fps))
        whole = len(_gap_frames(known, key, side, len(known)))
        span = min(round(span_s * fps), whole + 1)
        share = torch.as_tensor(np.abs(frames - key) / span, device=pose.roots.device).float()
        for steps, offset in zip(curves, added, strict=True):
            lacking = _velocity(steps, known, key, -side, behind) - _velocity(steps, known, key, side, 1)
            lone = not known[key - side]
            bump = side * span * share * (1 - share) ** 2 * (0.5 if lone else 1.0)
            offset[frames] += bump.view(-1, *[1] * (steps.dim() - 1)) * lacking
    local = in_blocks(lambda own, turns: multiply(own, from_turn_vectors(turns)), pose.local, added[0])
    offsets = pose.offsets + added[2] if pose.moves else pose.offsets
    gaps = np.flatnonzero(~known)
    return pose.with_rows(gaps, pose.with_local(local, pose.roots + added[1], offsets).rows(gaps))


def _velocity(steps: Tensor, known: np.ndarray, key: int, side: int, most: int) -> Tensor:
    """Mean step a frame on one side of a key: over up to `most` frames of the kind that lies next to it."""
    frames = 1
    while frames < most and 0 <= key + side * (frames + 1) < len(known) and known[key + side * (frames + 1)]:
        frames += 1
    part = steps[key : key + frames] if side > 0 else steps[key - frames : key]
    return part.mean(0)


def _gap_edges(known: np.ndarray) -> list[tuple[int, int]]:
    """Keys beside a gap with a frame on their other side too, and where the gap lies: 1 after, -1 before."""
    inner = np.flatnonzero(known[1:-1]) + 1
    return [(int(key), side) for key in inner for side in (1, -1) if not known[key + side]]


def _gap_frames(known: np.ndarray, key: int, side: int, most: int) -> np.ndarray:
    """Up to `most` frames of the gap on one side of a key, the nearest first."""
    frames = []
    frame = key + side
    while len(frames) < most and 0 <= frame < len(known) and not known[frame]:
        frames.append(frame)
        frame += side
    return np.array(frames, np.int64)
