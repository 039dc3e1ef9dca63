"""The bone that each point moves with, found from positions and body groups alone.

In the frames with a known pose, a point on a bone stands still in that bone's frame and is near the bone. Both
criteria together choose the bone. The point's weight states how certain the choice is.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Skeleton
from stages.shared.kinematics.rotations import matrices

MOST_FRAMES = 48  # more reference frames add no information


@dataclass(frozen=True)
class Binding:
    """Points tied to bones.

    joints:  (P,) long, the joint whose bone carries the point.
    in_bone: (P, 3) float32, the point in that joint's frame, metres.
    weights: (P,) float32 in [0, 1], certainty that the point is on this bone.
    wander:  (P,) float32, how far the point moves in its bone's frame over the reference frames (root mean square),
             metres; NaN for points without a bone.
    """

    joints: Tensor
    in_bone: Tensor
    weights: Tensor
    wander: Tensor


def bind_points(
    points: Tensor,
    groups: Tensor,
    skeleton: Skeleton,
    heads: Tensor,
    rotations: Tensor,
    *,
    still_m: float = 0.01,
    near_m: float = 0.06,
) -> Binding:
    """Tie every point to a sampled bone of its body group.

    Args:
        points: (K, P, 3) at K >= 1 frames with a known pose, metres.
        groups: (P,) body group of every point.
        heads: (K, J, 3) joints' heads at those frames.
        rotations: (K, J, 4) joints' global rotations, xyzw.
        still_m: expected movement of a point in the frame of its own bone, metres.
        near_m: expected distance of a point from the bone's line, metres.

    Raises: InputError if the skeleton has no bone that carries points.
    """
    if len(points) > MOST_FRAMES:
        chosen = torch.linspace(0, len(points) - 1, MOST_FRAMES, device=points.device).round().long()
        points, heads, rotations = points[chosen], heads[chosen], rotations[chosen]
    sampled = torch.as_tensor(skeleton.sampled, device=points.device)
    bone_groups = torch.as_tensor(skeleton.groups, device=points.device).long()
    if not bool(sampled.any()):
        raise InputError(
            "The skeleton has no bone that a point cloud can see.", "Check its body groups with inspect."
        )
    joints = torch.zeros(points.shape[1], dtype=torch.long, device=points.device)
    in_bone = torch.zeros_like(points[0])
    weights = torch.zeros_like(points[0, :, 0])
    strays = torch.full_like(weights, torch.nan)
    for group in range(len(BODY_GROUPS)):
        members = torch.nonzero(groups.long() == group).squeeze(-1)
        candidates = torch.nonzero(sampled & (bone_groups == group)).squeeze(-1)
        if len(members) == 0 or len(candidates) == 0:
            continue  # a weight of zero: points of a group without a bone in the skeleton are ignored
        frames = matrices(rotations[:, candidates])  # (K, C, 3, 3)
        away = points[:, members, None] - heads[:, None, candidates]  # (K, M, C, 3)
        place = torch.einsum("kcij,kmci->kmcj", frames, away)
        mean = place.mean(0)
        wander = (place - mean).square().sum(-1).mean(0)  # (M, C)
        tails = torch.as_tensor(skeleton.tails, dtype=points.dtype, device=points.device)[candidates]
        distance = _distance_to_segment(mean, tails)
        doubt = min(len(points), 8) * wander / (2 * still_m**2) + distance**2 / (2 * near_m**2)
        clarity, best = torch.softmax(-doubt, dim=-1).max(-1)
        row = torch.arange(len(members), device=points.device)
        joints[members], in_bone[members] = candidates[best], mean[row, best]
        weights[members] = clarity / (1 + wander[row, best] / (3 * still_m) ** 2)
        strays[members] = wander[row, best].sqrt()
    return Binding(joints, in_bone, weights, strays)


def _distance_to_segment(points: Tensor, tails: Tensor) -> Tensor:
    """Distance (M, C) of points (M, C, 3) from the lines from the origin to tails (C, 3)."""
    share = (points * tails).sum(-1) / tails.square().sum(-1).clamp(min=1e-12)
    return (points - share.clamp(0, 1).unsqueeze(-1) * tails).norm(dim=-1)


def carry_points(binding: Binding, heads: Tensor, rotations: Tensor) -> Tensor:
    """Bound points (T, P, 3) on any pose: heads (T, J, 3), global rotations (T, J, 4)."""
    frames = matrices(rotations)[:, binding.joints]
    return heads[:, binding.joints] + (frames @ binding.in_bone.unsqueeze(-1)).squeeze(-1)
