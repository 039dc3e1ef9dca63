"""The frame encoder: a point transformer that turns one frame's cloud into one latent vector (PUMPS 3.1).

It sees one frame at a time and every cloud by itself: no statistic crosses frames, windows or the batch.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from stages.kinematics.conventions import GROUPS
from stages.networks.sizes import EncoderSizes
from stages.pointcloud.neighbours import farthest_points, nearest_points, take


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

    The relative places enter by linear maps, so S p and V p are taken once for a point and not for each neighbour;
    what is left to do for a neighbour is one gather, one difference and one weighted sum.
    """

    def __init__(self, width: int, groups: int):
        super().__init__()
        self.groups = groups
        self.norm = nn.LayerNorm(width)
        self.query_key_value = nn.Linear(width, 3 * width)
        self.place = nn.Linear(3, 2 * width, bias=False)
        self.score = nn.Linear(width, groups)
        self.out = nn.Linear(width, width)

    def forward(self, features: Tensor, places: Tensor, neighbours: Tensor) -> Tensor:
        """Args:
            features: (N, P, C). places: (N, P, 3) metres. neighbours: (N, P, K).

        Returns: (N, P, C), with the residual.
        """
        clouds, points, count = neighbours.shape
        query, key, value = self.query_key_value(self.norm(features)).chunk(3, dim=-1)
        score_place, value_place = self.place(places).chunk(2, dim=-1)
        asked = take(torch.cat([key + score_place, value - value_place], dim=-1), neighbours)  # (N, P, K, 2C)
        key, value = asked.chunk(2, dim=-1)
        weight = self.score(F.gelu((query + score_place).unsqueeze(2) - key)).softmax(dim=2)  # over the neighbours
        mixed = value.view(clouds, points, count, self.groups, -1) * weight.unsqueeze(-1)
        return features + self.out(mixed.sum(2).flatten(2) + value_place)


class FrameEncoder(nn.Module):
    """Cloud of one frame -> latent, blocks of neighbour attention and farthest-point pooling to a quarter.

    The latent's width is `width * 2**blocks`; it is layer-normalised without parameters, so that its features have
    one scale and a squared error on it means something.
    """

    def __init__(self, sizes: EncoderSizes):
        super().__init__()
        self.sizes = sizes
        self.latent_width = sizes.width * 2**sizes.blocks
        self.embed = nn.Sequential(nn.Linear(6 + GROUPS, sizes.width), nn.GELU(), nn.Linear(sizes.width, sizes.width))
        widths = [sizes.width * 2**block for block in range(sizes.blocks)]
        self.attention = nn.ModuleList(NeighbourAttention(width, sizes.heads) for width in widths)
        self.widen = nn.ModuleList(
            nn.Sequential(
                nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, 2 * width)
            )
            for width in widths
        )

    def forward(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """Args:
            points: (N, P, 3) metres, N clouds of one frame each; any P.
            groups: (N, P) int64 body group of each point.

        Returns: latents (N, D), zero mean and unit variance each; centroids (N, 3) metres.
        """
        centroids = points.mean(dim=1)
        places = points - centroids.unsqueeze(1)
        one_hot = F.one_hot(groups.long(), GROUPS).to(points.dtype)
        features = self.embed(torch.cat([places, within_group(places, one_hot), one_hot], dim=-1))
        for block, (attend, widen) in enumerate(zip(self.attention, self.widen, strict=True)):
            neighbours = nearest_points(places, places, self.sizes.neighbours)
            features = widen(attend(features, places, neighbours))
            if block + 1 == self.sizes.blocks:
                break
            # Pooling: a quarter of the points, each with the strongest features among its neighbours.
            centres = farthest_points(places, -(-places.shape[1] // 4))
            around = torch.gather(neighbours, 1, centres.unsqueeze(2).expand(-1, -1, neighbours.shape[2]))
            features = take(features, around).amax(dim=2)
            places = take(places, centres)
        latents = features.amax(dim=1).float()
        return F.layer_norm(latents, latents.shape[-1:]), centroids
