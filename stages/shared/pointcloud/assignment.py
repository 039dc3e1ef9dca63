"""Pairing predicted with expected points by linear assignment (PUMPS 3.2), or by nearest neighbour (Chamfer)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from stages.shared.kinematics.conventions import GROUPS


def trajectory_costs(predicted: Tensor, expected: Tensor, valid: Tensor | None = None) -> Tensor:
    """Squared distance of whole trajectories, summed over the window.

    Args:
        predicted, expected: (B, T, P, 3) metres.
        valid: (B, T) True for real frames; None for all.

    Returns: (B, P, P), row = predicted point, column = expected point.
    """
    if valid is not None:
        keep = valid[..., None, None].to(predicted.dtype)
        predicted, expected = predicted * keep, expected * keep
    one = predicted.transpose(1, 2).flatten(2)
    two = expected.transpose(1, 2).flatten(2)
    square = one.square().sum(-1).unsqueeze(2) + two.square().sum(-1).unsqueeze(1)
    return (square - 2 * torch.bmm(one, two.transpose(1, 2))).clamp_min_(0)


def assign(costs: Tensor, groups: Tensor) -> Tensor:
    """The minimum-cost one-to-one pairing within each body group.

    Args:
        costs: (B, P, P).
        groups: (B, P) body group of each point, the same order for predicted and expected points.

    Returns: (B, P) int64, for each predicted point the index of its expected point.
    """
    # One transfer, and so one wait for the device, for all clouds and groups.
    together = torch.cat([costs.detach(), groups.unsqueeze(1).to(costs.dtype)], dim=1).cpu().numpy()
    table, group_of = together[:, :-1], together[:, -1].astype(np.int64)
    pairs = np.empty(group_of.shape, dtype=np.int64)

    def solve(cloud: int) -> None:
        for group in range(GROUPS):
            members = np.flatnonzero(group_of[cloud] == group)
            if len(members):
                rows, columns = linear_sum_assignment(table[cloud][np.ix_(members, members)])
                pairs[cloud, members[rows]] = members[columns]

    threads = min(torch.get_num_threads(), len(table))
    if threads > 1:  # SciPy's solver lets other threads run
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(solve, range(len(table))))
    else:
        for cloud in range(len(table)):
            solve(cloud)
    return torch.from_numpy(pairs).to(costs.device, non_blocking=True)


def paired_difference(predicted: Tensor, expected: Tensor, groups: Tensor, valid: Tensor | None = None) -> Tensor:
    """Predicted minus its assigned expected point, (B, T, P, 3) metres; gradients flow to both."""
    with torch.no_grad():
        pairs = assign(trajectory_costs(predicted, expected, valid), groups)
    index = pairs[:, None, :, None].expand(-1, expected.shape[1], -1, 3)
    return predicted - torch.gather(expected, 2, index)


def chamfer_squared(predicted: Tensor, expected: Tensor, groups: Tensor, valid: Tensor | None = None) -> Tensor:
    """Symmetric Chamfer distance on trajectories within body groups (the other objective of PUMPS Table 2), a
    scalar."""
    costs = trajectory_costs(predicted, expected, valid)
    apart = groups.unsqueeze(2) != groups.unsqueeze(1)
    costs = costs.masked_fill(apart, float("inf"))
    frames = predicted.shape[1] if valid is None else valid.sum(1).clamp_min(1).view(-1, 1)
    return 0.5 * ((costs.amin(2) / frames).mean() + (costs.amin(1) / frames).mean())
