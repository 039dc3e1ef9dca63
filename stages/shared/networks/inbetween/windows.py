"""From windows of bones to a method's gaps, and from its filled poses back to bones."""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.networks.inbetween.method import Gaps, Method
from stages.shared.networks.inbetween.pose_space import Placement, PoseSpace

Bones = tuple[Tensor, Tensor]
"""Heads (B, T, J, 3) metres and global rotations (B, T, J, 4) xyzw."""


def gaps_of(space: PoseSpace, given: Bones, base: Bones, known: Tensor, valid: Tensor) -> tuple[Gaps, Placement]:
    """The gaps of windows, and where the windows are.

    Args:
        given: bones that are read only where `known`.
        base: a plain interpolation of the known frames.
        known, valid: (B, T).
    """
    gate = known[..., None, None]
    heads, rotations = (torch.where(gate, one, other) for one, other in zip(given, base, strict=True))
    placed = space.placement(heads, known)
    plain = space.vectors(heads, rotations, placed)
    times = torch.arange(float(known.shape[1]), device=heads.device).unsqueeze(0)
    poses = torch.where(known.unsqueeze(-1), plain, 0)
    return Gaps(poses, plain, known, valid, times, space.offsets(*base)), placed


def denoised_bones(method: Method, noisy: Bones) -> Bones:
    """Noisy windows cleaned by a prior, every frame; the bones' positions follow from the rotations and the root."""
    heads, rotations = noisy
    every = torch.ones(heads.shape[:2], dtype=torch.bool, device=heads.device)
    placed = method.space.placement(heads, every)
    plain = method.space.vectors(heads, rotations, placed)
    times = torch.arange(float(heads.shape[1]), device=heads.device).unsqueeze(0)
    gaps = Gaps(torch.zeros_like(plain), plain, ~every, every, times, method.space.offsets(heads, rotations))
    return method.space.joints(method.denoise(gaps).detach(), gaps.offsets, placed)


def filled_bones(method: Method, given: Bones, base: Bones, known: Tensor, valid: Tensor | None = None) -> Bones:
    """The windows filled by a method; known frames are those given, unchanged. Arguments as in `gaps_of`."""
    gaps, placed = gaps_of(method.space, given, base, known, torch.ones_like(known) if valid is None else valid)
    poses = gaps.with_keys(method.fill(gaps).detach())
    gate = known[..., None, None]
    made = method.space.joints(poses, gaps.offsets, placed)
    return torch.where(gate, given[0], made[0]), torch.where(gate, given[1], made[1])
