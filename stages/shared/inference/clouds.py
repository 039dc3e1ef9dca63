"""Positions of drawn points in the poses of a skeleton."""

from __future__ import annotations

import torch
from torch import Tensor

from data_schemas.skeleton import Skeleton
from stages.shared.pointcloud.drawn_points import DrawnPoints
from stages.shared.solve.skeleton_pose import SkeletonPose

CHUNK_TOKENS = 1024  # placed or solved in one call
BLOCK_TOKENS = 4 * CHUNK_TOKENS  # whose clouds are in memory at once: bounds the memory of a long clip


def place_on_pose(drawn: DrawnPoints, pose: SkeletonPose, skeleton: Skeleton) -> Tensor:
    """Drawn points (T, P, 3) on a pose, a chunk at a time."""
    parts = []
    for start in range(0, len(pose.roots), CHUNK_TOKENS):
        heads, rotations = pose.rows(slice(start, start + CHUNK_TOKENS)).world()
        parts.append(drawn.place(heads, rotations))
    return torch.cat(parts)
