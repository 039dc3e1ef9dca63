"""Transforms of windows of different skeletons in their parents' frames, and back."""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.kinematics.rotations import conjugate, multiply, rotate


def in_parents(heads: Tensor, rotations: Tensor, parents: Tensor) -> tuple[Tensor, Tensor]:
    """Rotations (N, J, 4) and positions (N, J, 3) in the parents' frames.

    Args:
        heads: (N, J, 3) metres, of N frames. rotations: (N, J, 4) global, xyzw.
        parents: (N, J), -1 for bones without one, which stay as they are.
    """
    index, has_parent = parents.clamp_min(0), (parents >= 0).unsqueeze(-1)
    above = conjugate(torch.gather(rotations, 1, index.unsqueeze(-1).expand(-1, -1, 4)))
    local = torch.where(has_parent, multiply(above, rotations), rotations)
    apart = heads - torch.gather(heads, 1, index.unsqueeze(-1).expand(-1, -1, 3))
    return local, torch.where(has_parent, rotate(above, apart), heads)


def from_parents(local: Tensor, offsets: Tensor, parents: Tensor) -> tuple[Tensor, Tensor]:
    """Heads (B, T, J, 3) and global rotations (B, T, J, 4) of rotations and positions in the parents' frames.

    Args:
        local: (B, T, J, 4) xyzw. offsets: (B, T, J, 3) metres.
        parents: (B, J), -1 for bones without one; parents before children.
    """
    heads, rotations = offsets.clone(), local.clone()
    index, has_parent = parents.clamp_min(0), (parents >= 0).unsqueeze(-1)
    rows = torch.arange(len(local), device=local.device)
    for bone in range(1, local.shape[2]):
        turn = rotations[rows, :, index[:, bone]]
        place = heads[rows, :, index[:, bone]]
        hangs = has_parent[:, bone].unsqueeze(1)
        rotations[:, :, bone] = torch.where(hangs, multiply(turn, local[:, :, bone]), local[:, :, bone])
        moved = place + rotate(turn, offsets[:, :, bone])
        heads[:, :, bone] = torch.where(hangs, moved, offsets[:, :, bone])
    return heads, rotations
