"""The distance of two moving clouds without correspondence between their points (PC-MRL eqs. 4 and 5).

The distance of two points is that of their whole trajectories, divided by the root of the number of frames: the root
mean square over time, in metres. Eq. 4 sums the frames' distances instead; a norm over everything ranks near and far
alike, and comes out of one matrix product. The distance to points of other body groups is infinite. The loss is the
mean over the source's points and over the K points of the target that are nearest to each of them.

P x P tables are freed after each chunk; only the trajectories and K numbers a point are kept for the gradient.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from stages.shared.kinematics.conventions import GROUPS, MODEL_FPS

NEIGHBOURS = 8  # K of the paper
_TABLE_NUMBERS = 1 << 24  # distances in memory at once, over the batch: 64 MB
_FAR = 1e12  # square metres between body groups; exactly 0 is added within one
_LEAST = 1e-10  # square metres: keeps the root's slope finite if points coincide


class Neighbours(NamedTuple):
    """The K nearest target points of every source point.

    index:    (B, P, K) int64 into the target's points.
    distance: (B, P, K) metres, root mean square over time; differentiable.
    real:     (B, P, K) bool, False if the group has fewer than K target points.
    """

    index: Tensor
    distance: Tensor
    real: Tensor

    def mean(self) -> Tensor:
        """The mean distance over all real neighbours of all points of all clouds, a scalar."""
        return (self.distance * self.real).sum() / self.real.sum().clamp_min(1)

    def means(self) -> Tensor:
        """(B,) the mean distance of each cloud."""
        return (self.distance * self.real).sum((1, 2)) / self.real.sum((1, 2)).clamp_min(1)


def nearest_trajectories(
    source: Tensor,
    target: Tensor,
    source_groups: Tensor,
    target_groups: Tensor,
    valid: Tensor | None = None,
    count: int = NEIGHBOURS,
) -> Neighbours:
    """For each source point, the nearest target points of its body group, by whole trajectories.

    Args:
        source: (B, T, P, 3) metres. target: (B, T, Q, 3) metres.
        source_groups: (B, P) body groups. target_groups: (B, Q).
        valid: (B, T) True for real frames; None for all.
        count: K.
    """
    table = _Table(source, target, valid)
    one, two = (F.one_hot(g.long(), GROUPS).to(source.dtype) for g in (source_groups, target_groups))
    squares, indices = [], []
    for rows in table.chunks():
        apart = 1 - torch.bmm(one[:, rows], two.transpose(1, 2))
        nearest = (table.squares(rows) + _FAR * apart).topk(min(count, target.shape[2]), dim=-1, largest=False)
        squares.append(nearest.values)
        indices.append(nearest.indices)
    square = torch.cat(squares, dim=1)
    real = square < _FAR / 2
    square = torch.where(real, square, square.new_zeros(())).clamp_min(_LEAST)
    return Neighbours(torch.cat(indices, dim=1), square.sqrt(), real)


def distances_of(source: Tensor, target: Tensor, neighbours: Neighbours, valid: Tensor | None = None) -> Neighbours:
    """The same pairs in other trajectories (velocities, say): `neighbours` with new distances, in their unit."""
    table = _Table(source, target, valid)
    parts = [table.squares(rows).gather(2, neighbours.index[:, rows]) for rows in table.chunks()]
    return neighbours._replace(distance=torch.cat(parts, dim=1).clamp_min(_LEAST).sqrt())


class _Table:
    """Mean squared distances over time of source and target points, a few rows at a time."""

    def __init__(self, source: Tensor, target: Tensor, valid: Tensor | None):
        batch, frames, points, _ = source.shape
        keep = source.new_ones(batch, frames) if valid is None else valid.to(source.dtype)
        self.frames = keep.sum(1).clamp_min(1).view(-1, 1, 1)
        keep = keep[..., None, None]
        # Relative to the source's centre, so that the expanded square is precise.
        middle = (source.detach() * keep).sum((1, 2), keepdim=True) / (self.frames.unsqueeze(3) * points)
        self.source = ((source - middle) * keep).transpose(1, 2).flatten(2)
        self.target = ((target - middle) * keep).transpose(1, 2).flatten(2)
        self.source_square = self.source.square().sum(-1)
        self.target_square = self.target.square().sum(-1)

    def chunks(self) -> list[slice]:
        batch, points = self.source_square.shape
        rows = max(1, _TABLE_NUMBERS // max(1, batch * self.target_square.shape[1]))
        return [slice(start, start + rows) for start in range(0, points, rows)]

    def squares(self, rows: slice) -> Tensor:
        """(B, rows, Q) square metres."""
        cross = torch.bmm(self.source[:, rows], self.target.transpose(1, 2))
        square = self.source_square[:, rows].unsqueeze(2) + self.target_square.unsqueeze(1)
        return (square - 2 * cross) / self.frames


def velocities(points: Tensor, valid: Tensor | None = None) -> tuple[Tensor, Tensor | None]:
    """Points (B, T, P, 3) metres to (B, T - 1, P, 3) metres a second, and which of them are real."""
    real = None if valid is None else valid[:, 1:] & valid[:, :-1]
    return (points[:, 1:] - points[:, :-1]) * MODEL_FPS, real


def normalised_by_group(points: Tensor, groups: Tensor, valid: Tensor | None = None) -> Tensor:
    """Each body group around its own mean in every frame, in units of its own spread over the window.

    The result depends on how a limb is bent and where it points, not on its length and position.

    Args:
        points: (B, T, P, 3). groups: (B, P). valid: (B, T), None for all.

    Returns: (B, T, P, 3), without unit.
    """
    one_hot = F.one_hot(groups.long(), GROUPS).to(points.dtype)  # (B, P, G)
    share = (one_hot / one_hot.sum(1, keepdim=True).clamp_min(1)).transpose(1, 2).unsqueeze(1)  # (B, 1, G, P)
    centred = points - one_hot.unsqueeze(1) @ (share @ points)
    spread = (share @ centred.square()).sum(-1)  # (B, T, G)
    if valid is None:
        spread = spread.mean(1)
    else:
        keep = valid.unsqueeze(-1).to(points.dtype)
        spread = (spread * keep).sum(1) / keep.sum(1).clamp_min(1)
    scale = (spread + 1e-6).sqrt()
    return centred / (one_hot @ scale.unsqueeze(-1)).unsqueeze(1)
