"""The reconstruction network of PC-MRL (3.2, 4.2): a moving cloud in, the motion of one rig out.

A point transformer encodes each frame's cloud, a transformer with rotary positions processes the frames' features in
time (the variant that PUMPS compares with), and two linear layers give the pelvis' position and every seen bone's
global rotation.

Limits: a cloud around a bone is the same for every roll of the bone about its own axis, so the roll of an arm or a
shin shows only in bones that are attached to it at an angle (a foot on the shin, hips on the pelvis). Within one
sequence the movement of the points shows how the roll *changes* (first-frame offsets, PC-MRL 3.3), which
`stages.shared.kinematics.foq` uses. Points do not determine the roll itself. `skeleton_losses.roll_loss` keeps it
near the rig's rest pose.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from stages.shared.kinematics.conventions import GROUPS
from stages.shared.kinematics.rotations import multiply
from stages.shared.networks.layers.attention import TimeLayer
from stages.shared.networks.layers.row_generator import draw_normal, draw_uniform
from stages.shared.networks.layers.sizes import EncoderSizes, SkeletonSizes
from stages.shared.networks.pumps.frame_encoder import FrameEncoder
from stages.shared.pointcloud.drawn_points import DrawnPoints
from stages.shared.pointcloud.heading import headings_of, turned, yaw_quaternions
from stages.shared.pointcloud.rig import RigBody, pose_heads

UPPER = (0, 1, 2, 4, 5, 8)  # of a symmetric 3 x 3 matrix
MOMENTS = GROUPS * (3 + len(UPPER))


class RigPose(NamedTuple):
    """A posed body of B bones.

    heads: (..., T, B, 3) metres. rotations: (..., T, B, 4) global unit quaternions xyzw.
    raw:   (..., T, S, 4) the network's output for the S seen bones, before normalising.
    """

    heads: Tensor
    rotations: Tensor
    raw: Tensor


class Seen(NamedTuple):
    """The encoding of each frame by itself: features (B, T, W), centroids (B, T, 3) in the frame's own heading, yaw
    (B, T) that turned the cloud into it."""

    features: Tensor
    centroids: Tensor
    yaw: Tensor


class SkeletonNetwork(nn.Module):
    """Maps clouds (B, T, P, 3) with body groups to the pose of one rig's body.

    The cloud's centroid is subtracted in every frame and added to the pelvis again, so that the result does not
    depend on the motion's position; with `SkeletonSizes.heading` it does not depend on its heading either.
    """

    def __init__(self, body: RigBody, encoder: EncoderSizes, sizes: SkeletonSizes):
        super().__init__()
        self.body, self.sizes = body, sizes
        self.seen = torch.nonzero(body.weights > 0).squeeze(1).tolist()
        self.encoder = FrameEncoder(encoder)
        self.embed = nn.Linear(self.encoder.latent_width + MOMENTS, sizes.width)
        self.layers = nn.ModuleList(TimeLayer(sizes.width, sizes.heads) for _ in range(sizes.layers))
        self.norm = nn.LayerNorm(sizes.width)
        self.hidden = nn.Linear(sizes.width, sizes.width)
        self.out = nn.Linear(sizes.width, 3 + 4 * len(self.seen))
        with torch.no_grad():  # it starts from the rig's rest pose
            self.out.weight.mul_(0.1)
            self.out.bias[:3] = 0
            self.out.bias[3:] = body.rest_world[self.seen].flatten()

    def forward(self, points: Tensor, groups: Tensor, times: Tensor, valid: Tensor | None = None) -> RigPose:
        """Args:
        points: (B, T, P, 3) metres. groups: (B, P) body groups; the order of points has no effect.
        times: (B or 1, T) model frames. valid: (B, T) True for real frames; None for all.
        """
        return self.pose(self.see(points, groups, self.headings(points, groups, valid)), times, valid)

    def headings(self, points: Tensor, groups: Tensor, valid: Tensor | None = None) -> Tensor:
        """(B, T) yaw by which each frame's cloud is turned before it is encoded; zeros without `sizes.heading`."""
        return headings_of(points, groups, valid) if self.sizes.heading else torch.zeros_like(points[:, :, 0, 0])

    def see(self, points: Tensor, groups: Tensor, yaw: Tensor) -> Seen:
        """Encode each frame by itself: points (B, T, P, 3), groups (B, P), yaw (B, T)."""
        frames = points.shape[1]
        each, each_groups = turned(points, yaw.unsqueeze(-1)).flatten(0, 1), groups.repeat_interleave(frames, 0)
        latents, centroids = self.encoder(each, each_groups)
        features = self.embed(torch.cat([latents, group_moments(each, each_groups)], dim=-1))
        return Seen(features.unflatten(0, (-1, frames)), centroids.unflatten(0, (-1, frames)), yaw)

    def pose(self, seen: Seen, times: Tensor, valid: Tensor | None = None) -> RigPose:
        """The pose of encoded frames."""
        features, centroids, yaw = seen
        for layer in self.layers:
            features = layer(features, times, known=valid)
        said = self.out(F.relu(self.hidden(self.norm(features)))).float()
        pelvis = turned(centroids.float() + said[..., :3], -yaw)
        raw = said[..., 3:].unflatten(-1, (-1, 4))
        turns = raw / raw.norm(dim=-1, keepdim=True).clamp_min(1e-6)
        turns = multiply(yaw_quaternions(-yaw).unsqueeze(2).expand(*turns.shape), turns)
        return self._pose(pelvis, turns, raw)

    def _pose(self, pelvis: Tensor, turns: Tensor, raw: Tensor) -> RigPose:
        """Bones without points keep their rest rotation in the parent's frame."""
        body, place = self.body, {bone: index for index, bone in enumerate(self.seen)}
        rest = body.rest_local.to(turns)
        out: list[Tensor] = []
        for bone, parent in enumerate(body.parents.tolist()):
            if bone in place:
                out.append(turns[..., place[bone], :])
            elif parent < 0:
                out.append(rest[bone].expand(*turns.shape[:-2], 4))
            else:
                out.append(multiply(out[parent], rest[bone].expand(*turns.shape[:-2], 4)))
        rotations = torch.stack(out, dim=-2)
        return RigPose(pose_heads(body, pelvis, rotations), rotations, raw)


def group_moments(points: Tensor, groups: Tensor) -> Tensor:
    """Mean and covariance of every body group around the cloud's centroid, (N, 45) in units of half a metre.

    Args:
        points: (N, P, 3) metres. groups: (N, P). A group without points counts as at the centroid.
    """
    one_hot = F.one_hot(groups.long(), GROUPS).to(points.dtype)
    share = (one_hot / one_hot.sum(1, keepdim=True).clamp_min(1)).transpose(1, 2)
    places = (points - points.mean(dim=1, keepdim=True)) * 2
    means = torch.bmm(share, places)
    apart = places - torch.bmm(one_hot, means)
    squares = (apart.unsqueeze(-1) * apart.unsqueeze(-2)).flatten(2)[..., UPPER]
    return torch.cat([means, 4 * torch.bmm(share, squares)], dim=-1).flatten(1)


def draw_own_points(body: RigBody, sigma: Tensor, groups: Tensor, generator: torch.Generator) -> DrawnPoints:
    """Points on the body's bones, of the body groups asked for, in proportion to the bones' lengths (eq. 3).

    Args:
        sigma: (B,) metres, one draw for each.
        groups: (B, P). For a group that the body lacks, any bone is used; the point then has the bone's group.
        generator: on the device of the result.
    """
    batch, device = len(sigma), generator.device
    shape = groups.shape
    tails, weights, groups_of = body.tails.to(device), body.weights.to(device), body.groups.to(device)
    mine = (groups_of == groups.to(device).unsqueeze(-1)) * weights  # (B, P, bones)
    mine = torch.where(mine.sum(-1, keepdim=True) > 0, mine, weights)
    ends = mine.cumsum(-1)
    # Just under the end at most: bones without a weight are never chosen, not even by rounding.
    place = draw_uniform(shape, generator, device).unsqueeze(-1) * ends[..., -1:] * (1 - 1e-6)
    bones = torch.searchsorted(ends, place, right=True).squeeze(-1)
    alphas = draw_uniform(shape, generator, device)
    offsets = draw_normal((*shape, 3), generator, device)
    return DrawnPoints(bones, alphas, offsets, groups_of[bones], tails.expand(batch, -1, 3), sigma.to(device))
