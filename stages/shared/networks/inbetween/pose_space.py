"""One skeleton's poses as vectors: the root's position and local rotations as two columns of their matrices.

The columns are the 6D representation of Zhou et al. (On the continuity of rotation representations, 2019). A window
is turned so that its body faces +Z at its first known frame, and moved on the ground so that the known roots' mean is
at the origin; heights stay. Both are found from the known frames alone. Vectors are standardised by the mean and
deviation of training poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from stages.shared.kinematics.forward import global_rotations, joint_positions, local_rotations
from stages.shared.kinematics.rotations import conjugate, from_matrices, matrices, multiply, rotate
from stages.shared.pointcloud.heading import headings_of, turned, yaw_quaternions

_LEAST_DEVIATION = 0.01  # metres, or matrix entries; a value that never changes is not blown up by its noise


@dataclass(frozen=True)
class Placement:
    """Where windows are: yaw (B,) radians that turns a window to face +Z; origin (B, 3) metres, its height 0."""

    yaw: Tensor
    origin: Tensor


class PoseSpace(nn.Module):
    """Poses of J bones as vectors of D = 3 + 6 J numbers, and back.

    Args:
        parents: J of them, -1 for the root, which comes first; parents before children.
        groups: J body groups, which give left and right and so the heading.
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, parents: list[int], groups: list[int]):
        super().__init__()
        self.parents, self.groups = np.array(parents), list(groups)
        self.register_buffer("mean", torch.zeros(self.width))
        self.register_buffer("deviation", torch.ones(self.width))

    @property
    def bones(self) -> int:
        """J."""
        return len(self.parents)

    @property
    def width(self) -> int:
        """D."""
        return 3 + 6 * self.bones

    def set_statistics(self, poses: Tensor) -> None:
        """Standardise by the mean and deviation of poses (N, D) that are not standardised yet."""
        self.mean.copy_(poses.mean(0))
        self.deviation.copy_(poses.std(0).clamp_min(_LEAST_DEVIATION))

    def placement(self, heads: Tensor, known: Tensor) -> Placement:
        """The placement of windows.

        Args:
            heads: (B, T, J, 3) metres, a plain interpolation of the known frames.
            known: (B, T), at least one True in every row.
        """
        groups = torch.tensor(self.groups, device=heads.device).expand(len(heads), -1)
        first = known.int().argmax(1, keepdim=True)
        yaw = headings_of(heads, groups).gather(1, first).squeeze(1)
        weight = known.unsqueeze(-1).to(heads.dtype)
        origin = (heads[:, :, 0] * weight).sum(1) / weight.sum(1)
        return Placement(yaw, origin * torch.tensor([1.0, 0.0, 1.0], device=heads.device))

    def vectors(self, heads: Tensor, rotations: Tensor, placed: Placement) -> Tensor:
        """Standardised vectors (B, T, D) of heads (B, T, J, 3) metres and global rotations (B, T, J, 4)."""
        roots = turned(heads[:, :, 0] - placed.origin.unsqueeze(1), placed.yaw.unsqueeze(1))
        turn = yaw_quaternions(placed.yaw)[:, None, None]
        local = local_rotations(rotations, self.parents)
        local = torch.cat([multiply(turn, local[:, :, :1]), local[:, :, 1:]], dim=2)
        columns = matrices(local)[..., :2].flatten(2)
        return (torch.cat([roots, columns], dim=-1) - self.mean) / self.deviation

    def local(self, vectors: Tensor) -> Tensor:
        """(..., J, 4) rotations in the parents' frames of standardised vectors (..., D); the root's in its window."""
        columns = (vectors * self.deviation + self.mean)[..., 3:].unflatten(-1, (-1, 3, 2))
        first = nn.functional.normalize(columns[..., 0], dim=-1)
        second = columns[..., 1] - (first * columns[..., 1]).sum(-1, keepdim=True) * first
        second = nn.functional.normalize(second, dim=-1)
        third = torch.linalg.cross(first, second, dim=-1)
        return from_matrices(torch.stack([first, second, third], dim=-1))

    def with_local(self, vectors: Tensor, local: Tensor) -> Tensor:
        """Vectors (..., D) with other local rotations (..., J, 4); the root's position stays."""
        columns = matrices(local)[..., :2].flatten(-3)
        return torch.cat([vectors[..., :3], (columns - self.mean[3:]) / self.deviation[3:]], dim=-1)

    def joints(self, vectors: Tensor, offsets: Tensor, placed: Placement | None = None) -> tuple[Tensor, Tensor]:
        """Heads (B, T, J, 3) and global rotations (B, T, J, 4) by forward kinematics; in the world with `placed`,
        otherwise in the window's own placement.

        Args:
            vectors: (B, T, D) standardised. offsets: (B, T, J, 3) in the parents' frames, metres.
        """
        roots = vectors[..., :3] * self.deviation[:3] + self.mean[:3]
        local = self.local(vectors)
        if placed is not None:
            roots = turned(roots, -placed.yaw.unsqueeze(1)) + placed.origin.unsqueeze(1)
            back = yaw_quaternions(-placed.yaw)[:, None, None]
            local = torch.cat([multiply(back, local[:, :, :1]), local[:, :, 1:]], dim=2)
        rotations = global_rotations(local, self.parents)
        return joint_positions(rotations, roots, offsets, self.parents), rotations

    def offsets(self, heads: Tensor, rotations: Tensor) -> Tensor:
        """(B, T, J, 3) heads in the parents' frames, metres; the root's are 0."""
        above = torch.as_tensor(self.parents[1:], device=heads.device)
        steps = rotate(conjugate(rotations[:, :, above]), heads[:, :, 1:] - heads[:, :, above])
        return nn.functional.pad(steps, (0, 0, 1, 0))
