"""CITL in one skeleton's pose space, as PC-MRL (3.4) changes it: FOQ in and out, learned relative positions.

Three stages of attention: over the keys alone; from the missing frames (a learned token each) to the encoded keys;
over all frames. What it sees of a frame are the root's place, every bone's first-frame-offset quaternion and the
direction its bone points in, so nothing of it depends on a bone's absolute roll, nor on the skeleton's rest pose.
Ours: the world is moved so that the first key faces one way and the keys' roots are at the origin, and what comes
out is a residual on a plain interpolation of the keys, zero before training.
"""

from __future__ import annotations

from dataclasses import dataclass

import roma
import torch
from torch import Tensor, nn

from stages.kinematics.foq import first_frame_offsets, rotations_from_offsets
from stages.networks.relative_attention import RelativeLayer
from stages.networks.sizes import InterpolatorSizes
from stages.networks.synthesiser import key_distance, place_in_gap
from stages.pointcloud.heading import across_of, turned, yaw_quaternions

_FAR_FRAMES = 15.0  # from here on, a missing frame's residual is at its full size
_FAR_M = 0.1  # the size of a root's residual there, metres
_FAR_RAD = 0.1  # and of a bone's, radians: steps of training that are small beside what a plain interpolation misses


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
        groups: J body groups, which tell left from right and so the heading.
    """

    def __init__(self, parents: list[int], groups: list[int], sizes: InterpolatorSizes):
        super().__init__()
        self.sizes, self.parents, self.groups = sizes, list(parents), list(groups)
        width, features = sizes.width, 3 + 9 * len(parents)
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
            truth: read where `known` alone.
            base: a plain interpolation made from the known frames alone, equal to them there.
            known: (B, T) True = the frame is given; the first always is.
            times: (B or 1, T) model frames, real-valued, rising.
            valid: (B, T) True for real frames, False for padding (never known); None for all.

        Returns: heads (B, T, J, 3) and global rotations (B, T, J, 4); known frames come back as given.
        """
        if not bool(known[:, 0].all()):
            raise ValueError("first-frame offsets need the first frame of every window to be known")
        times = times.expand_as(known)
        gate = known[..., None, None]
        heads = torch.where(gate, truth.heads, base.heads)
        rotations = torch.where(gate, truth.rotations, base.rotations)
        yaw, origin = self._placing(heads, known)
        facing = yaw_quaternions(yaw).view(-1, 1, 1, 4).expand_as(rotations)
        offsets = first_frame_offsets(roma.quat_product(facing, rotations))
        roots = turned(heads[:, :, 0] - origin, yaw.unsqueeze(-1))
        features = self._features(roots, offsets, rotations, truth.tails, yaw)
        residual = self._fill(features, known, times, valid)

        far = key_distance(known, times).div(_FAR_FRAMES).clamp(max=1).unsqueeze(-1)
        residual = residual.float() * torch.where(known.unsqueeze(-1), 0, far)
        # The further residual by `far` makes a root's error grow with the square of the distance to the key.
        roots = roots + _FAR_M * far * residual[..., :3]
        turns = roma.rotvec_to_unitquat(_FAR_RAD * residual[..., 3:].unflatten(-1, (-1, 3)))
        offsets = roma.quat_product(turns, offsets)
        first = roma.quat_product(facing[:, 0], rotations[:, 0])
        made = rotations_from_offsets(offsets, first)
        made = roma.quat_product(roma.quat_conjugation(facing), made)
        made_heads = self._heads(turned(roots, -yaw.unsqueeze(-1)) + origin, made, heads, rotations)
        return torch.where(gate, truth.heads, made_heads), torch.where(gate, truth.rotations, made)

    def _placing(self, heads: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
        """Yaw (B,) that makes the first frame face +Z, and the mean (B, 1, 3) of the keys' roots."""
        groups = torch.tensor(self.groups, device=heads.device).expand(len(heads), -1)
        across = across_of(heads[:, :1], groups)[:, 0]
        weight = known.unsqueeze(-1).to(heads.dtype)
        origin = (heads[:, :, 0] * weight).sum(1, keepdim=True) / weight.sum(1, keepdim=True)
        return torch.atan2(across[:, 1], across[:, 0]), origin

    def _features(self, roots: Tensor, offsets: Tensor, rotations: Tensor, tails: Tensor, yaw: Tensor) -> Tensor:
        """(B, T, 3 + 9 J): the root's place, FOQ as two columns of their matrices, the bones' directions."""
        directions = roma.quat_action(rotations, tails.unsqueeze(1).expand(*rotations.shape[:-1], 3))
        directions = nn.functional.normalize(turned(directions, yaw.view(-1, 1, 1)), dim=-1)
        columns = roma.unitquat_to_rotmat(offsets)[..., :2]
        return torch.cat([roots, columns.flatten(2), directions.flatten(2)], dim=-1)

    def _fill(self, features: Tensor, known: Tensor, times: Tensor, valid: Tensor | None) -> Tensor:
        """What the attention says of every frame, (B, T, 3 + 3 J)."""
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
        out = [roots]
        for bone in range(1, len(self.parents)):
            above = self.parents[bone]
            inverse = roma.quat_conjugation(rotations[:, :, above])
            offset = roma.quat_action(inverse, heads[:, :, bone] - heads[:, :, above])
            out.append(out[above] + roma.quat_action(made[:, :, above], offset))
        return torch.stack(out, dim=2)
