"""Farthest points and nearest neighbours of clouds, batched over clouds."""

from __future__ import annotations

import torch
from torch import Tensor


def squared_distances(first: Tensor, second: Tensor) -> Tensor:
    """(N, A, 3), (N, B, 3) -> (N, A, B) squared metres, by the expanded square, clamped at zero."""
    cross = torch.bmm(first, second.transpose(1, 2))
    square = first.square().sum(-1).unsqueeze(2) + second.square().sum(-1).unsqueeze(1)
    return (square - 2 * cross).clamp_min_(0)


def farthest_points(points: Tensor, count: int) -> Tensor:
    """Farthest-first traversal: each next point is the one farthest from those chosen.

    The first is the point farthest from the centroid, so that the order of points means nothing.

    Args:
        points: (N, P, 3).
        count: how many to choose, at most P.

    Returns: (N, count) int64 indices.
    """
    clouds, total, _ = points.shape
    distance = (points - points.mean(dim=1, keepdim=True)).square().sum(-1)
    chosen = torch.empty(clouds, count, dtype=torch.long, device=points.device)
    nearest = torch.full((clouds, total), float("inf"), device=points.device, dtype=points.dtype)
    rows = torch.arange(clouds, device=points.device)
    for step in range(count):
        index = distance.argmax(dim=1)
        chosen[:, step] = index
        nearest = torch.minimum(nearest, (points - points[rows, index].unsqueeze(1)).square().sum(-1))
        distance = nearest
    return chosen


def nearest_points(points: Tensor, centres: Tensor, count: int) -> Tensor:
    """The `count` nearest points of each centre (itself among them, where it is a point).

    Args:
        points: (N, P, 3).
        centres: (N, C, 3).

    Returns: (N, C, min(count, P)) int64 indices into the points, in no order.
    """
    count = min(count, points.shape[1])
    if count == points.shape[1]:
        whole = torch.arange(count, device=points.device)
        return whole.expand(points.shape[0], centres.shape[1], count)
    return squared_distances(centres, points).topk(count, dim=-1, largest=False, sorted=False).indices


def take(values: Tensor, index: Tensor) -> Tensor:
    """values (N, P, C) at index (N, ...) -> (N, ..., C): one flat gather, which is the fast way on a CPU."""
    clouds, total, width = values.shape
    start = torch.arange(clouds, device=values.device).view(-1, *([1] * (index.dim() - 1))) * total
    return (
        values.reshape(clouds * total, width).index_select(0, (index + start).reshape(-1)).view(*index.shape, width)
    )
