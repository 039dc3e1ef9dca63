"""The frame encoder: a point transformer that turns one frame's cloud into one latent vector (PUMPS 3.1).

It encodes every frame's cloud by itself: no statistic is shared between frames, windows or the batch.
"""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from stages.shared.kinematics.conventions import GROUPS
from stages.shared.networks.layers.attention import ExactNorm
from stages.shared.networks.layers.layer_stack import Checkpointed
from stages.shared.networks.layers.pieces import in_pieces, rows_per_piece
from stages.shared.networks.layers.sizes import EncoderSizes
from stages.shared.pointcloud.neighbours import Level, pooling_levels, take


def within_group(points: Tensor, one_hot: Tensor) -> Tensor:
    """Positions normalised by their own body group's mean and spread in the same frame, (N, P, 3).

    Args:
        points: (N, P, 3). one_hot: (N, P, 5).
    """
    share = one_hot / one_hot.sum(1, keepdim=True).clamp_min(1)
    mean = torch.bmm(share.transpose(1, 2), points)
    centred = points - torch.bmm(one_hot, mean)
    spread = torch.bmm(share.transpose(1, 2), centred.square()).sum(-1, keepdim=True)
    return centred / torch.bmm(one_hot, (spread + 1e-6).sqrt())


class NeighbourAttention(nn.Module):
    """Grouped vector attention over k nearest neighbours, one weight for each channel group:

        y_i = sum_j softmax_j(g(gelu(q_i - k_j + S (p_i - p_j)))) (v_j + V (p_i - p_j)).

    The relative positions enter by linear maps, so S p and V p are computed once for a point and not for each
    neighbour. The work for a neighbour is one gather, one sum and one weighted sum.
    """

    def __init__(self, width: int, groups: int):
        super().__init__()
        self.groups = groups
        self.norm = ExactNorm(width)
        self.query_key_value = nn.Linear(width, 3 * width)
        self.place = nn.Linear(3, 2 * width, bias=False)
        self.score = nn.Linear(width, groups)
        self.out = nn.Linear(width, width)

    def used_parameters(self) -> list[nn.Parameter]:
        """Parameters that the result depends on, and that have gradients."""
        return [each for each in self.parameters() if each is not self.score.bias]

    def forward(self, features: Tensor, places: Tensor, neighbours: Tensor) -> Tensor:
        """Args:
            features: (N, P, C). places: (N, P, 3) metres. neighbours: (N, P, K).

        Returns: (N, P, C), with the residual.
        """
        clouds, points, width = features.shape
        rows = neighbour_rows(neighbours, points)
        projected = self.query_key_value(self.norm(features)).view(-1, 3 * width)
        query, key, value = projected.chunk(3, dim=-1)
        score_place, value_place = self.place(places).view(-1, 2 * width).chunk(2, dim=-1)
        # The neighbours come first in (K, N P, C): all following operations, sums over k included, then run over
        # contiguous memory.
        inner = F.gelu(select_rows(-(key + score_place), rows).add_(query + score_place))
        # Over the neighbours. The bias of `score` is the same for all of them and has no effect, and adding it takes
        # longer than the product. It is a parameter because checkpoints contain it; it is not trained.
        weight = F.linear(inner, self.score.weight).softmax(dim=0)
        # Each group's weight for all its channels, by a small product, which is faster than copies.
        spread = torch.eye(self.groups, dtype=weight.dtype, device=weight.device)
        spread = spread.repeat_interleave(width // self.groups, dim=1)
        mixed = (select_rows(value - value_place, rows) * (weight @ spread)).sum(0)
        return features + self.out(mixed + value_place).view(clouds, points, width)


def neighbour_rows(neighbours: Tensor, points: int) -> Tensor:
    """Indices (N, Q, K) into N clouds of `points` points -> (K, N Q) into the rows of all clouds."""
    clouds, asked, count = neighbours.shape
    start = torch.arange(0, clouds * points, points, device=neighbours.device).view(-1, 1, 1)
    return (neighbours + start).view(clouds * asked, count).t().contiguous()


def select_rows(values: Tensor, rows: Tensor) -> Tensor:
    """values (R, C) at rows (K, M) -> (K, M, C)."""
    return values.index_select(0, rows.view(-1)).view(*rows.shape, values.shape[-1])


class FrameEncoder(nn.Module, Checkpointed):
    """Cloud of one frame -> latent, blocks of neighbour attention and farthest-point pooling to a quarter.

    The latent's width is `width * 2**blocks`; it is layer-normalised without parameters, so that its features have
    one scale and a squared error on it is meaningful.

    With checkpointing only each block's input is kept for the backward pass.
    """

    def __init__(self, sizes: EncoderSizes):
        super().__init__()
        self.sizes = sizes
        self.latent_width = sizes.width * 2**sizes.blocks
        self.embed = nn.Sequential(nn.Linear(6 + GROUPS, sizes.width), nn.GELU(), nn.Linear(sizes.width, sizes.width))
        widths = [sizes.width * 2**block for block in range(sizes.blocks)]
        self.attention = nn.ModuleList(NeighbourAttention(width, sizes.heads) for width in widths)
        self.widen = nn.ModuleList(
            nn.Sequential(ExactNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, 2 * width))
            for width in widths
        )

    def forward(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """Args:
            points: (N, P, 3) metres, N clouds of one frame each; any P.
            groups: (N, P) int64 body group of each point.

        Returns: latents (N, D), zero mean and unit variance each; centroids (N, 3) metres.
        """
        # Not in bfloat16, which would round the positions, and so the order of neighbours, by centimetres.
        with torch.autocast(points.device.type, enabled=False):
            centroids = points.mean(dim=1)
            places = points - centroids.unsqueeze(1)
            one_hot = F.one_hot(groups.long(), GROUPS).to(points.dtype)
            inputs = torch.cat([places, within_group(places, one_hot), one_hot], dim=-1)
            levels = pooling_levels(places, self.sizes.blocks, self.sizes.neighbours)
        features = self.embed(inputs)
        for block, level in enumerate(levels):
            features = self._block(block, features, places, level)
            if level.centres is not None:
                places = take(places, level.centres)
        latents = features.amax(dim=1).to(points.dtype)
        return F.layer_norm(latents, latents.shape[-1:]), centroids

    def _block(self, block: int, features: Tensor, places: Tensor, level: Level) -> Tensor:
        """Attention, widening and, if there is one, pooling: (N, P, C) -> (N, P / 4, 2C), clouds at a time."""
        attend, widen = cast(NeighbourAttention, self.attention[block]), self.widen[block]
        neighbours = level.neighbours

        def run(features: Tensor, places: Tensor, neighbours: Tensor, around: Tensor | None = None) -> Tensor:
            wide = widen(attend(features, places, neighbours))
            if around is None:
                return wide
            # A quarter of the points, each with the strongest features among its neighbours.
            rows = neighbour_rows(around, wide.shape[1])
            return select_rows(wide.flatten(0, 1), rows).amax(dim=0).view(*around.shape[:2], -1)

        parts = [features, places, neighbours]
        if level.centres is not None:
            every = level.centres.unsqueeze(2).expand(-1, -1, neighbours.shape[2])
            parts.append(torch.gather(neighbours, 1, every))
        again, values = self.checkpointing, neighbours[0].numel() * features.shape[-1]
        clouds = rows_per_piece(features.device, values, checkpointing=again)
        learnt = [*attend.used_parameters(), *widen.parameters()]
        return in_pieces(run, clouds, parts, learnt, checkpointing=again)
