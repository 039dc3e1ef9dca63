"""CITL in one skeleton's pose space, as PC-MRL (3.4) changes it: FOQ in and out, learned relative positions.

Three stages of attention: over the keys alone; from the missing frames (a learned token each) to the encoded keys;
over all frames. Its inputs for a frame are every bone's first-frame-offset quaternion, every bone's direction, and
the root's movement from and to the neighbouring keys. So they do not depend on a bone's absolute roll or on the
skeleton's rest pose. Two parts are not in the paper: each frame is turned to face one direction, by the heading of a
plain interpolation of keys, and the output is a residual on that interpolation, zero before training.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from stages.shared.kinematics.foq import first_frame_offsets, rotations_from_offsets
from stages.shared.kinematics.forward import joint_positions
from stages.shared.kinematics.rotations import conjugate, from_turn_vectors, matrices, multiply, rotate
from stages.shared.networks.layers.relative_attention import RelativeLayer
from stages.shared.networks.layers.sizes import InterpolatorSizes
from stages.shared.networks.pumps.synthesiser import key_distance, neighbouring_keys, place_in_gap
from stages.shared.pointcloud.heading import headings_of, turned

_FAR_FRAMES = 15.0  # from here on, a missing frame's residual is at its full size
_FAR_M = 0.2  # the size of a root's residual there, metres
_FAR_RAD = 0.3  # and of a bone's, radians: about the error of a plain interpolation in a second's gap


@dataclass(frozen=True)
class PoseWindows:
    """Windows of one hierarchy's bones.

    heads (B, T, J, 3) metres, rotations (B, T, J, 4) global xyzw, tails (B, J, 3) in the bones' frames.
    """

    heads: Tensor
    rotations: Tensor
    tails: Tensor


class PoseInterpolator(nn.Module):
    """Known poses in, all poses out.

    Args:
        parents: J of them, -1 for the root, which comes first; parents before children.
        groups: J body groups, which give left and right and so the heading.
    """

    def __init__(self, parents: list[int], groups: list[int], sizes: InterpolatorSizes):
        super().__init__()
        self.sizes, self.parents, self.groups = sizes, list(parents), list(groups)
        width, features = sizes.width, 11 + 9 * len(parents)
        self.embed_key = nn.Linear(features, width)
        self.embed_missing = nn.Linear(features + 8, width)
        self.missing_token = nn.Parameter(torch.randn(width) * 0.02)

        def layers(count: int, asks_memory: bool = False) -> nn.ModuleList:
            made = (RelativeLayer(width, sizes.heads, sizes.longest, asks_memory=asks_memory) for _ in range(count))
            return nn.ModuleList(made)

        self.key_layers = layers(sizes.key_layers)
        self.fill_layers = layers(sizes.fill_layers, asks_memory=True)
        self.frame_layers = layers(sizes.frame_layers)
        self.norm = nn.LayerNorm(width)
        self.out = nn.Linear(width, 3 + 3 * len(parents))
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self,
        truth: PoseWindows,
        base: PoseWindows,
        known: Tensor,
        times: Tensor,
        valid: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Args:
            truth: read only where `known`.
            base: a plain interpolation of the known frames only, equal to them there.
            known: (B, T) True = the frame is given; the first always is.
            times: (B or 1, T) model frames, real-valued, rising.
            valid: (B, T) True for real frames, False for padding (never known); None for all.

        Returns: heads (B, T, J, 3) and global rotations (B, T, J, 4); known frames are returned as given.
        """
        if not bool(known[:, 0].all()):
            raise ValueError("first-frame offsets need the first frame of every window to be known")
        times = times.expand_as(known)
        gate = known[..., None, None]
        heads = torch.where(gate, truth.heads, base.heads)
        rotations = torch.where(gate, truth.rotations, base.rotations)
        groups = torch.tensor(self.groups, device=heads.device).expand(len(heads), -1)
        yaw = headings_of(heads, groups, valid)
        offsets = first_frame_offsets(rotations)
        directions = rotate(rotations, truth.tails.unsqueeze(1).expand(*rotations.shape[:-1], 3))
        features = torch.cat([self._way(heads[:, :, 0], yaw, known), _seen(offsets, directions, yaw)], dim=-1)
        residual = self._fill(features, known, times, valid)

        far = key_distance(known, times).div(_FAR_FRAMES).clamp(max=1).unsqueeze(-1)
        # The error of the plain interpolation grows faster than the distance to the key, and so must the residual.
        residual = residual.float() * torch.where(known.unsqueeze(-1), 0, far**1.5)
        roots = heads[:, :, 0] + turned(_FAR_M * residual[..., :3], -yaw)
        turns = turned(_FAR_RAD * residual[..., 3:].unflatten(-1, (-1, 3)), -yaw.unsqueeze(-1))
        offsets = multiply(from_turn_vectors(turns), offsets)
        made = rotations_from_offsets(offsets, rotations[:, 0])
        made_heads = self._heads(roots, made, heads, rotations)
        return torch.where(gate, truth.heads, made_heads), torch.where(gate, truth.rotations, made)

    def _way(self, roots: Tensor, yaw: Tensor, known: Tensor) -> Tensor:
        """(B, T, 11): the root's height above the keys' mean; the root's movements from the key before and to the key
        after, in the frame's heading, metres; cosines and sines of the turns from and to their headings."""
        weight = known.to(roots.dtype)
        height = roots[..., 1] - (roots[..., 1] * weight).sum(1, keepdim=True) / weight.sum(1, keepdim=True)
        parts = [height.unsqueeze(-1)]
        for key in neighbouring_keys(known):
            there = roots.gather(1, key.unsqueeze(-1).expand_as(roots))
            angle = yaw - yaw.gather(1, key)
            parts += [turned(there - roots, yaw), angle.cos().unsqueeze(-1), angle.sin().unsqueeze(-1)]
        return torch.cat(parts, dim=-1)

    def _fill(self, features: Tensor, known: Tensor, times: Tensor, valid: Tensor | None) -> Tensor:
        """The attention's output for every frame, (B, T, 3 + 3 J)."""
        keys = self.embed_key(features * known.unsqueeze(-1))
        for layer in self.key_layers:
            keys = layer(keys, times, known=known)
        missing = self.embed_missing(torch.cat([features, place_in_gap(known, times)], dim=-1)) + self.missing_token
        for layer in self.fill_layers:
            missing = layer(missing, times, memory=keys, known=known)
        frames = torch.where(known.unsqueeze(-1), keys, missing)
        for layer in self.frame_layers:
            frames = layer(frames, times, known=valid)
        return self.out(self.norm(frames))

    def _heads(self, roots: Tensor, made: Tensor, heads: Tensor, rotations: Tensor) -> Tensor:
        """Forward kinematics of roots (B, T, 3) and global rotations, on the bone offsets of the base."""
        above = self.parents[1:]
        inverse = conjugate(rotations[:, :, above])
        steps = rotate(inverse, heads[:, :, 1:] - heads[:, :, above])
        offsets = nn.functional.pad(steps, (0, 0, 1, 0))
        return joint_positions(made, roots, offsets, np.array(self.parents))


def _seen(offsets: Tensor, directions: Tensor, yaw: Tensor) -> Tensor:
    """FOQ as two columns of their matrices, and bones' directions, in each frame's own heading: (B, T, 9 J)."""
    around = yaw.unsqueeze(-1)
    turns = turned(offsets[..., :3], around)  # in another heading only a rotation's axis is turned
    columns = matrices(torch.cat([turns, offsets[..., 3:]], dim=-1))[..., :2]
    directions = nn.functional.normalize(turned(directions, around), dim=-1)
    return torch.cat([columns.flatten(2), directions.flatten(2)], dim=-1)
