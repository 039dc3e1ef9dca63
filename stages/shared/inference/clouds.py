"""Clouds on a skeleton: points drawn on its bones, and where they are in its poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Skeleton
from stages.shared.pointcloud.sampling import draw_points, place_points, points_in_bone, spread_points
from stages.shared.solve.skeleton_pose import SkeletonPose

CHUNK_TOKENS = 1024  # bounds the memory of a long clip


class DrawnPoints(NamedTuple):
    """Points drawn on a skeleton. Only `groups` goes to the models and the solve, never `bones`."""

    bones: Tensor  # (P,)
    in_bone: Tensor  # (P, 3)
    groups: Tensor  # (P,)


def draw_on_skeleton(
    skeleton: Skeleton, points: int, rng: np.random.Generator, sigma_m: float, device: torch.device | str = "cpu"
) -> DrawnPoints:
    """Points drawn on the sampled bones, each with probability proportional to its length."""
    lengths = np.linalg.norm(skeleton.tails, axis=-1) * skeleton.sampled
    drawn = draw_points(lengths, points, rng)
    bones, alphas, offsets = (torch.as_tensor(part, device=device) for part in drawn)
    tails = torch.as_tensor(skeleton.tails, dtype=torch.float32, device=device)
    groups = torch.as_tensor(skeleton.groups, device=device).long()[bones.long()]
    return DrawnPoints(bones, points_in_bone(tails, bones, alphas, offsets, sigma_m), groups)


def spread_on_skeleton(
    skeleton: Skeleton, points: int, start: float, sigma_m: float, device: torch.device | str = "cpu"
) -> DrawnPoints:
    """Points spread evenly over the sampled bones; `start` in [0, 1) tells one such spread from another."""
    tails = torch.as_tensor(skeleton.tails, dtype=torch.float32, device=device)
    lengths = tails.norm(dim=-1) * torch.as_tensor(skeleton.sampled, device=device)
    bones, alphas, offsets = spread_points(lengths, points, torch.tensor(start, device=device))
    groups = torch.as_tensor(skeleton.groups, device=device).long()[bones]
    return DrawnPoints(bones, points_in_bone(tails, bones, alphas, offsets, sigma_m), groups)


def place_on_pose(drawn: DrawnPoints, pose: SkeletonPose, skeleton: Skeleton) -> Tensor:
    """Drawn points (T, P, 3) on a pose, a chunk at a time."""
    parts = []
    for start in range(0, len(pose.roots), CHUNK_TOKENS):
        heads, rotations = pose.rows(slice(start, start + CHUNK_TOKENS)).world()
        parts.append(place_points(heads, rotations, drawn.bones, drawn.in_bone))
    return torch.cat(parts)
