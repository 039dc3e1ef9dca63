"""Points drawn on bones: the bone of each, and its position in the bone's frame (PC-MRL eq. 3).

One type for all draws, one cloud or a batch: on a file's skeleton, on a training window's bones, on a rig's body. The
points that a `tpc` artefact stores are the same draw as NumPy arrays (`data_schemas.tpc.BoneSet`), since that package
has no torch.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Skeleton
from stages.shared.pointcloud.sampling import draw_points, place_points, points_in_bone, spread_points


@dataclass(frozen=True, eq=False)
class DrawnPoints:
    """P points drawn on J bones; leading dimensions are clouds of a batch.

    `dataclasses.replace` of `sigma_m` or `tails` scatters the same draw wider or puts it on a body of another size.
    Networks and the solve get `groups`, never `bones`.

    bones:   (..., P) the bone of each point.
    alphas:  (..., P) how far along it, 0 at its head, 1 at its tail.
    offsets: (..., P, 3) standard normal draws in the bone's frame, scaled by `sigma_m`.
    groups:  (..., P) int64 body groups; left and right are exchanged if the cloud is mirrored.
    tails:   (..., J, 3) of the bones, metres in their own frames.
    sigma_m: metres; a number, or (...) with one for each cloud.
    """

    bones: Tensor
    alphas: Tensor
    offsets: Tensor
    groups: Tensor
    tails: Tensor
    sigma_m: Tensor | float

    @cached_property
    def in_bone(self) -> Tensor:
        """(..., P, 3) metres, the points in their bones' frames: H_x ~ N(alpha T_n, sigma)."""
        return points_in_bone(self.tails, self.bones, self.alphas, self.offsets, self.sigma_m)

    def place(self, heads: Tensor, rotations: Tensor) -> Tensor:
        """Points (..., T, P, 3) metres in the world, of the bones' heads (..., T, J, 3) and global rotations
        (..., T, J, 4) xyzw."""
        return place_points(heads, rotations, self.bones, self.in_bone)


def drawn_on_bones(
    draw: Iterable[Tensor],
    groups: np.ndarray | Tensor,
    tails: np.ndarray | Tensor,
    sigma_m: float,
    device: torch.device | str = "cpu",
) -> DrawnPoints:
    """A draw of `stages.shared.pointcloud.sampling`, with what the bones give to their points.

    Args:
        draw: bones, alphas and offsets of P points. groups: (J,) body groups of the bones. tails: (J, 3) metres.
    """
    bones, alphas, offsets = (part.to(device) for part in draw)
    of_points = torch.as_tensor(groups, device=device).long()[bones.long()]
    return DrawnPoints(
        bones, alphas, offsets, of_points, torch.as_tensor(tails, dtype=torch.float32, device=device), sigma_m
    )


def draw_on_skeleton(
    skeleton: Skeleton, points: int, rng: np.random.Generator, sigma_m: float, device: torch.device | str = "cpu"
) -> DrawnPoints:
    """Points drawn on the sampled bones, each with probability proportional to its length."""
    lengths = np.linalg.norm(skeleton.tails, axis=-1) * skeleton.sampled
    draw = map(torch.as_tensor, draw_points(lengths, points, rng))
    return drawn_on_bones(draw, skeleton.groups, skeleton.tails, sigma_m, device)


def spread_on_skeleton(
    skeleton: Skeleton, points: int, start: float, sigma_m: float, device: torch.device | str = "cpu"
) -> DrawnPoints:
    """Points spread evenly over the sampled bones; `start` in [0, 1) selects one such spread."""
    lengths = torch.as_tensor(skeleton.tails, dtype=torch.float32, device=device).norm(dim=-1)
    lengths = lengths * torch.as_tensor(skeleton.sampled, device=device)
    draw = spread_points(lengths, points, torch.tensor(start, device=device))
    return drawn_on_bones(draw, skeleton.groups, skeleton.tails, sigma_m, device)
