"""How far a reconstructed cloud is from the true one, once its points are paired (PUMPS 3.2, Table 2).

Every figure is one number for a window, so that means over clips and their intervals can be taken. Two independent
draws of the true cloud, measured the same way, give the level that a perfect decoder would reach.
"""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.kinematics.conventions import GROUPS
from stages.shared.pointcloud.assignment import trajectory_costs


def distances(apart: Tensor, valid: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
    """Matched pairs' mean distance, its variation over time, and their mean squared distance.

    Args:
        apart: (B, T, P, 3) metres, each pair's difference (`paired_difference`).
        valid: (B, T) True for real frames; None for all.

    Returns: (B,) mean norm of the differences, metres; (B,) mean norm of the differences less their mean over time,
        metres; (B,) mean squared norm, square metres (L_rec of PUMPS 3.2, as a mean over points and frames).
    """
    valid = torch.ones(apart.shape[:2], device=apart.device) if valid is None else valid
    keep = valid.unsqueeze(-1).to(apart.dtype)
    frames = keep.sum(1, keepdim=True).clamp_min(1)
    constant = (apart * keep.unsqueeze(-1)).sum(1, keepdim=True) / frames.unsqueeze(-1)
    count = frames.flatten() * apart.shape[2]
    whole = (apart.norm(dim=-1) * keep).sum((1, 2)) / count
    moving = ((apart - constant).norm(dim=-1) * keep).sum((1, 2)) / count
    square = (apart.square().sum(-1) * keep).sum((1, 2)) / count
    return whole, moving, square


def spread_ratios(made: Tensor, points: Tensor, groups: Tensor) -> Tensor:
    """Standard deviation of a cloud's points about their body group's mean, predicted over true; 1 is right.

    Args:
        made, points: (B, T, P, 3) metres. groups: (B, P).

    Returns: (B, 5), means over time; not-a-number for a group of fewer than two points.
    """
    ratios = []
    for group in range(GROUPS):
        weight = (groups == group)[:, None, :, None].to(points.dtype)
        count = weight.sum(2, keepdim=True)
        spread = []
        for cloud in (made, points):
            mean = (cloud * weight).sum(2, keepdim=True) / count
            square = ((cloud - mean).square() * weight).sum((2, 3)) / count.flatten(1)
            spread.append(square.sqrt().mean(1))
        ratio = spread[0] / spread[1]
        ratios.append(ratio.masked_fill(count.flatten() < 2, float("nan")))
    return torch.stack(ratios, dim=1)


def nearest_differences(predicted: Tensor, expected: Tensor, groups: Tensor, valid: Tensor | None = None) -> Tensor:
    """Differences to the nearest trajectory of the group, both ways: the pairs of the Chamfer distance, whose mean
    squared norm is `assignment.chamfer_squared`.

    Args: predicted, expected: (B, T, P, 3) metres. groups: (B, P). valid: (B, T) True for real frames.

    Returns: (B, T, 2 P, 3) metres, each predicted point less its nearest expected one, then each expected point's
        nearest predicted one less it.
    """
    with torch.no_grad():
        costs = trajectory_costs(predicted, expected, valid)
        costs = costs.masked_fill(groups.unsqueeze(2) != groups.unsqueeze(1), float("inf"))
        forth, back = costs.argmin(2), costs.argmin(1)

    def taken(points: Tensor, index: Tensor) -> Tensor:
        return torch.gather(points, 2, index[:, None, :, None].expand(-1, points.shape[1], -1, 3))

    return torch.cat([predicted - taken(expected, forth), taken(predicted, back) - expected], dim=2)


def chamfer_distance(made: Tensor, points: Tensor, groups: Tensor) -> Tensor:
    """Root-mean-square distance over time from each point's trajectory to the nearest one of its body group, mean
    over points and both directions.

    Args: as `spread_ratios`. Returns: (B,) metres.
    """
    costs = trajectory_costs(made, points).masked_fill(groups.unsqueeze(2) != groups.unsqueeze(1), float("inf"))
    nearest = (costs / made.shape[1]).sqrt()
    return 0.5 * (nearest.amin(2).mean(1) + nearest.amin(1).mean(1))


def jerk(points: Tensor, fps: float) -> Tensor:
    """Mean norm of the points' third derivative, (B,) metres a second cubed; points (B, T, P, 3), T of 4 or more."""
    return points.diff(n=3, dim=1).norm(dim=-1).mean((1, 2)) * fps**3
