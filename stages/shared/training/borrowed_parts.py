"""Windows whose upper body moves as in another recording: kinds of motion that nobody recorded together."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.conventions import BODY_GROUPS
from stages.shared.kinematics.window_hierarchy import from_parents, in_parents

if TYPE_CHECKING:
    from stages.shared.training.windows import Windows

_ARMS = [name.endswith("arm") for name in BODY_GROUPS]
_LEGS = [name.endswith("leg") for name in BODY_GROUPS]
_UPPER_BODY = [not leg for leg in _LEGS]


def with_borrowed_parts(windows: Windows, lenders: Windows, arms_alone: np.ndarray) -> Windows:
    """Windows in which the bones of both arms, and of the spine too, turn at their parents as in `lenders`.

    The root, the legs, the bones that carry them, and all bones' lengths stay. A window ends where either of the two
    ends.

    Args:
        windows, lenders: as many windows, each pair of one skeleton.
        arms_alone: (B,) bool, where the spine stays.
    """
    groups = torch.where(
        torch.from_numpy(arms_alone).unsqueeze(1), torch.tensor(_ARMS), torch.tensor(_UPPER_BODY)
    ).to(windows.groups.device)
    legs = torch.tensor(_LEGS).to(windows.groups.device)[windows.groups]
    borrowed = torch.gather(groups, 1, windows.groups) & ~_with_ancestors(legs, windows.parents)
    borrowed[:, 0] = False
    local, offsets = _local(windows)
    local = torch.where(borrowed[:, None, :, None], _local(lenders)[0], local)
    heads, rotations = from_parents(local, offsets, windows.parents)
    moved = _with_descendants(borrowed, windows.parents)[:, None, :, None]
    return replace(
        windows,
        heads=torch.where(moved, heads, windows.heads),
        rotations=torch.where(moved, rotations, windows.rotations),
        valid=windows.valid & lenders.valid,
    )


def _local(windows: Windows) -> tuple[Tensor, Tensor]:
    batch, frames = windows.heads.shape[:2]
    parents = windows.parents.repeat_interleave(frames, dim=0)
    local, offsets = in_parents(windows.heads.flatten(0, 1), windows.rotations.flatten(0, 1), parents)
    return local.unflatten(0, (batch, frames)), offsets.unflatten(0, (batch, frames))


def _with_descendants(bones: Tensor, parents: Tensor) -> Tensor:
    """(B, J) bool: the bones and all that hang from them."""
    moved = bones.clone()
    for bone in range(1, bones.shape[1]):  # parents come before children
        above = moved.gather(1, parents[:, bone : bone + 1].clamp_min(0)).squeeze(1)
        moved[:, bone] |= above & (parents[:, bone] >= 0)
    return moved


def _with_ancestors(bones: Tensor, parents: Tensor) -> Tensor:
    """(B, J) bool: the bones and all from which they hang."""
    carrying = bones.clone()
    for bone in range(bones.shape[1] - 1, 0, -1):
        above = parents[:, bone : bone + 1]
        carries = carrying[:, bone : bone + 1] & (above >= 0)
        carrying.scatter_(1, above.clamp_min(0), carrying.gather(1, above.clamp_min(0)) | carries)
    return carrying
