"""Farthest points and nearest neighbours of clouds, batched over clouds.

`pooling_levels` gives all that the frame encoder needs from positions: which points are neighbours and which are
kept, level by level. It depends only on positions, so it is computed once for a batch, without gradient.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

# Clouds that are searched at once: their distances (4 MB) fit in the caches, and all threads have some clouds.
_DISTANCES_AT_ONCE, _CLOUDS_AT_MOST = 2**20, 64


class Level(NamedTuple):
    """neighbours (N, P, K) int64 of every point of a level; centres (N, ceil(P / 4)) int64, the points that the next
    level keeps, None at the last."""

    neighbours: Tensor
    centres: Tensor | None


def pooling_levels(places: Tensor, levels: int, count: int) -> list[Level]:
    """The `count` nearest neighbours at each level, and the quarter of its points, the farthest ones, that the next
    level keeps.

    Args:
        places: (N, P, 3); no gradient flows through the result.
        levels: how many, at least 1. count: neighbours of a point, itself included; all points if a level has fewer.
    """
    places = places.detach()
    if places.device.type == "cpu" and len(places) > 0:
        return _pooling_levels_cpu(places, levels, count)
    found = []
    for level in range(levels):
        neighbours = nearest_points(places, places, count)
        centres = farthest_points(places, quarter(places.shape[1])) if level + 1 < levels else None
        found.append(Level(neighbours, centres))
        if centres is not None:
            places = take(places, centres)
    return found


def quarter(points: int) -> int:
    """Number of points of a level that are kept, at least one."""
    return -(-points // 4)


def squared_distances(first: Tensor, second: Tensor) -> Tensor:
    """(N, A, 3), (N, B, 3) -> (N, A, B) squared metres, by the expanded square, clamped at zero."""
    # One product of (-2 a, |a|^2, 1) and (b, 1, |b|^2), which writes the result once.
    one, two = first.square().sum(-1, keepdim=True), second.square().sum(-1, keepdim=True)
    left = torch.cat([-2 * first, one, torch.ones_like(one)], dim=-1)
    right = torch.cat([second, torch.ones_like(two), two], dim=-1)
    return torch.bmm(left, right.transpose(1, 2)).clamp_min_(0)


def farthest_points(points: Tensor, count: int) -> Tensor:
    """Farthest-first traversal: each next point is the one farthest from those chosen.

    The first is the point farthest from the centroid, so that the order of points has no effect.

    Args:
        points: (N, P, 3).
        count: number of points to choose, at most P.

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
    """The `count` nearest points of each centre (the centre included, if it is a point).

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
    """values (N, P, C) at index (N, ...) -> (N, ..., C): one flat gather, which is fastest on a CPU."""
    clouds, total, width = values.shape
    start = torch.arange(clouds, device=values.device).view(-1, *([1] * (index.dim() - 1))) * total
    return (
        values.reshape(clouds * total, width).index_select(0, (index + start).reshape(-1)).view(*index.shape, width)
    )


def _pooling_levels_cpu(places: Tensor, levels: int, count: int) -> list[Level]:
    """`pooling_levels` in NumPy, whose selection and argmax are several times as fast as PyTorch's on a CPU: a few
    clouds at a time, so that their distances stay in the caches, in as many threads as PyTorch may use."""
    threads = torch.get_num_threads()
    neighbours: list[list[np.ndarray]] = [[] for _ in range(levels)]
    centres: list[list[np.ndarray]] = [[] for _ in range(levels - 1)]

    def of_share(share: tuple[Tensor, Tensor]) -> tuple[list[np.ndarray], list[np.ndarray]]:
        return _levels_of(share[0].numpy(), share[1].numpy(), levels, count)

    clouds = max(1, min(_CLOUDS_AT_MOST, _DISTANCES_AT_ONCE // max(1, places.shape[1]) ** 2))
    with ThreadPoolExecutor(threads) as pool:
        for some in places.float().split(threads * clouds):
            shares = zip(some.split(clouds), squared_distances(some, some).split(clouds), strict=True)
            for found in (pool.map if threads > 1 else map)(of_share, shares):
                for lists, arrays in zip((neighbours, centres), found, strict=True):
                    for all_clouds, these in zip(lists, arrays, strict=True):
                        all_clouds.append(these)
    kept = [torch.from_numpy(np.concatenate(each)) for each in centres]
    return [
        Level(torch.from_numpy(np.concatenate(each)), one)
        for each, one in zip(neighbours, [*kept, None], strict=True)
    ]


def _levels_of(
    places: np.ndarray, apart: np.ndarray, levels: int, count: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Neighbours and centres of a few clouds (N, P, 3) with squared distances (N, P, P), level by level."""
    neighbours, centres = [], []
    rows = np.arange(len(places))[:, None]
    for level in range(levels):
        neighbours.append(_nearest_columns(apart, count))
        if level + 1 < levels:
            kept = _farthest_rows(places, apart, quarter(places.shape[1]))
            centres.append(kept)
            # Distances are symmetric: rows are indexed twice, which copies contiguous memory and not single numbers.
            places, apart = places[rows, kept], apart[rows, kept].transpose(0, 2, 1)[rows, kept]
    return neighbours, centres


def _nearest_columns(apart: np.ndarray, count: int) -> np.ndarray:
    """Columns of the `count` smallest values in every row of (N, P, P), int64, in no order; the first of equal ones.

    Floats of one sign are ordered like their bits. The column replaces the last bits, so a selected key contains its
    column, and selecting 32 bits is twice as fast as 64. The few rows in which the remaining bits do not separate the
    last of the nearest from the next are selected again by all bits.
    """
    points = apart.shape[-1]
    if count >= points:
        return np.broadcast_to(np.arange(points), apart.shape)
    last = (1 << (points - 1).bit_length()) - 1
    keys = apart.view(np.int32) & np.int32(~last)
    keys |= np.arange(points, dtype=np.int32)
    keys.partition(count, axis=-1)
    nearest = keys[..., :count]
    columns = (nearest & last).astype(np.int64)
    doubtful = (nearest.max(axis=-1) | last) >= keys[..., count]
    if doubtful.any():
        columns[doubtful] = _nearest_columns_by_all_bits(apart[doubtful], count)
    return columns


def _nearest_columns_by_all_bits(apart: np.ndarray, count: int) -> np.ndarray:
    """`_nearest_columns` of rows (R, P), with the whole column below the whole value."""
    keys = apart.view(np.int32).astype(np.int64)
    keys <<= 32
    keys |= np.arange(apart.shape[-1])
    keys.partition(count - 1, axis=-1)
    return keys[..., :count] & 0xFFFFFFFF


def _farthest_rows(places: np.ndarray, apart: np.ndarray, count: int) -> np.ndarray:
    """`farthest_points`, given the squared distances."""
    rows = np.arange(len(places))
    chosen = np.empty((len(places), count), dtype=np.int64)
    nearest = np.full(apart.shape[:2], np.inf, dtype=apart.dtype)
    index = np.square(places - places.mean(axis=1, keepdims=True)).sum(-1).argmax(axis=1)
    for step in range(count):
        chosen[:, step] = index
        np.minimum(nearest, apart[rows, index], out=nearest)
        index = nearest.argmax(axis=1)
    return chosen
