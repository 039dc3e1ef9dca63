"""Plain interpolation of a batch of windows of different skeletons at once, on bones' global transforms."""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.kinematics.device import onto
from stages.shared.kinematics.plain_interpolation import (
    DAMPING,
    Damping,
    Glide,
    damped_smoothness,
    glide_on,
    interpolate_pose,
)
from stages.shared.kinematics.window_hierarchy import from_parents, in_parents

_APART = 100_000.0  # frames between windows on the joined timeline: no tangent crosses this distance


def interpolate_windows(
    heads: Tensor,
    rotations: Tensor,
    parents: Tensor,
    known: Tensor,
    *,
    rate_hz: float,
    glide: Glide | None = None,
    damping: Damping = DAMPING,
) -> tuple[Tensor, Tensor]:
    """The damped `interpolate_pose` of each window's known frames, with the window's own hierarchy.

    The windows are put on one long timeline, so that one call interpolates all. A window that ends (or begins)
    without a key holds its last (first) key, or glides on from it.

    Args:
        heads: (B, T, J, 3) metres. rotations: (B, T, J, 4) global, xyzw.
        parents: (B, J), -1 for the pelvis, which comes first, and for unused bones; parents before children. The
            pelvis alone may turn right round between two keys.
        known: (B, T) on the CPU, at least one True in every row; other frames are not read.
        rate_hz: frames in a second; used by the damping of long gaps (`damped_smoothness`).
        glide: how to continue before the first and after the last key, in frames; None holds them.

    Returns: heads (B, T, J, 3) and global rotations (B, T, J, 4).
    """
    batch, frames, bones = heads.shape[:3]
    times = torch.arange(frames, dtype=torch.float64) + _APART * torch.arange(batch, dtype=torch.float64).unsqueeze(1)
    window, frame = _held_keys(known)
    source = _nearest_known(known)[window, frame]
    # The positions of keys are computed on the CPU, to avoid waiting for a GPU.
    key_times = times[window, frame]
    smooth = damped_smoothness(key_times, rate_hz, damping)
    device = heads.device
    window, source = onto(window, device), onto(source, device)
    key_heads = heads[window, source]
    local, offsets = in_parents(key_heads, rotations[window, source], parents[window])

    whole_turns = torch.arange(bones) == 0
    local, _, offsets = interpolate_pose(
        local, key_heads[:, 0], offsets, key_times, times.flatten(), smooth=smooth, whole_turns=whole_turns
    )
    local, offsets = local.view(batch, frames, bones, 4), offsets.view(batch, frames, bones, 3)
    if glide is not None and any(glide):
        row, at, edge, inner = (onto(part, device) for part in _beyond_keys(known))
        edges, inners = (in_parents(heads[row, key], rotations[row, key], parents[row]) for key in (edge, inner))
        gap, away = (edge - inner).abs().float(), (at - edge).abs().float()
        local[row, at], offsets[row, at] = glide_on((edges[0], inners[0]), (edges[1], inners[1]), gap, away, glide)

    return from_parents(local, offsets, parents)


def _beyond_keys(known: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Windows and frames (N,) before the first or after the last key, that key's frame, and the frame of the key next
    to it (the same frame if there is no other)."""
    frames = torch.arange(known.shape[1]).expand_as(known)
    far = known.shape[1]
    first = torch.where(known, frames, far).amin(1, keepdim=True)
    last = torch.where(known, frames, -1).amax(1, keepdim=True)
    second = torch.where(known & (frames > first), frames, far).amin(1, keepdim=True)
    last_but_one = torch.where(known & (frames < last), frames, -1).amax(1, keepdim=True)
    edge = torch.where(frames > last, last, first)
    inner = torch.where(frames > last, last_but_one, second)
    inner = torch.where((inner < 0) | (inner == far), edge, inner)
    row, at = ((frames < first) | (frames > last)).nonzero(as_tuple=True)
    return row, at, edge[row, at], inner[row, at]


def _held_keys(known: Tensor) -> tuple[Tensor, Tensor]:
    """Windows and frames of all keys, with keys added at the ends of windows without one there."""
    with_ends = known.clone()
    with_ends[:, 0] = True
    with_ends[:, -1] = True
    window, frame = with_ends.nonzero(as_tuple=True)
    return window, frame


def _nearest_known(known: Tensor) -> Tensor:
    """(B, T): the known frame that holding gives: the last one up to the frame, or else the first."""
    frames = torch.arange(known.shape[1]).expand_as(known)
    before = torch.where(known, frames, -1).cummax(dim=1).values
    first = known.int().argmax(dim=1, keepdim=True)
    return torch.where(before < 0, first, before)
