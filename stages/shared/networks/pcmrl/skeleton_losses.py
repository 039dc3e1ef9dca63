"""Losses of PC-MRL's network besides the distance of clouds: terms on the skeleton itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.conventions import GROUPS
from stages.shared.kinematics.rotations import conjugate, multiply
from stages.shared.pointcloud.rig import RigBody


def unit_quaternion_loss(raw: Tensor, valid: Tensor | None = None) -> Tensor:
    """Mean squared difference of the lengths of raw quaternions (B, T, S, 4) from 1 (PC-MRL 4.2, L_q)."""
    return _mean((raw.norm(dim=-1) - 1).square().mean(-1), valid)


def roll_loss(rotations: Tensor, body: RigBody, valid: Tensor | None = None) -> Tensor:
    """Mean over the seen bones below the pelvis of sin^2 of half the roll: 0 at rest, 1 for half a turn.

    The roll is the part about the bone's own axis of the rotation from rest in its parent's frame. Clouds do not
    determine it (see `stages.shared.networks.pcmrl.skeleton_network`).

    Args:
        rotations: (B, T, bones, 4) global.
    """
    bones = [bone for bone, weight in enumerate(body.weights.tolist()) if weight > 0 and body.parents[bone] >= 0]
    if not bones:
        return rotations.new_zeros(())
    parents = [int(body.parents[bone]) for bone in bones]
    local = multiply(conjugate(rotations[..., parents, :]), rotations[..., bones, :])
    rest = conjugate(body.rest_local[bones].to(local)).expand_as(local)
    away = multiply(rest, local)
    axis = body.tails[bones].to(local)
    axis = axis / axis.norm(dim=-1, keepdim=True)
    about = (away[..., :3] * axis).sum(-1)
    share = about.square() / (
        about.square() + away[..., 3].square() + 1e-4
    )  # 1e-4: a swing of 180 degrees has no roll
    return _mean(share.mean(-1), valid)


def end_bones(parents: np.ndarray, groups: np.ndarray, tails: np.ndarray, weights: np.ndarray) -> list[int]:
    """Bones that begin at the head, the hands and the feet, for each body group; -1 for a group without one.

    That of a limb is the child of the lower one of its two longest bones, so that toes make no difference; the
    spine's last bone is the head.

    Args:
        parents: (B,), -1 for the root and for unused rows, parents before children. groups: (B,). tails: (B, 3).
        weights: (B,), 0 for bones not seen.
    """
    lengths = np.linalg.norm(tails, axis=1)
    ends = []
    for group in range(GROUPS):
        mine = np.flatnonzero((np.asarray(groups) == group) & (np.asarray(weights) > 0))
        if group == 0 or len(mine) == 0:
            ends.append(int(mine[-1]) if len(mine) else -1)
            continue
        lower = max(mine[np.argsort(-lengths[mine], kind="stable")[:2]])
        below = np.flatnonzero(np.asarray(parents) == lower)
        ends.append(int(below[0]) if len(below) else -1)
    return ends


def end_effector_loss(ends: Tensor, expected: Tensor, pairs: Sequence[bool] | Tensor, valid: Tensor | None) -> Tensor:
    """L_end of PC-MRL eq. 6: the pairs' distances, mean over time, summed over pairs; mean over the batch, metres.

    Args:
        ends, expected: (B, T, E, 3) metres. pairs: (E,) or (B, E), True if both sides have the end.
    """
    distance = (ends - expected).norm(dim=-1)
    there = torch.as_tensor(pairs, device=distance.device).to(distance.dtype)
    there = there if there.dim() == 1 else there.unsqueeze(1)
    return _mean((distance * there).sum(-1), valid)


def _mean(values: Tensor, valid: Tensor | None) -> Tensor:
    """Mean of (B, T) over real frames; each window has the same weight."""
    if valid is None:
        return values.mean()
    keep = valid.to(values.dtype)
    return ((values * keep).sum(1) / keep.sum(1).clamp_min(1)).mean()
