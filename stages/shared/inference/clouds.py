"""The clouds of a fill: points on the plain interpolation, and where the same points should be.

The models see positions, body groups and times; which bone a point was drawn on stays here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.token_times import Tokens
from stages.shared.kinematics.conventions import MIRRORED_GROUP, MODEL_FPS
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.pointcloud.heading import turned
from stages.shared.pointcloud.sampling import draw_points, place_points, points_in_bone, spread_points
from stages.shared.solve.binding import Binding, bind_points
from stages.shared.solve.local_pose import LocalPose, pose_of_motion

CloudSource = Literal["synthesised", "reconstructed", "true", "latents"]
CHUNK_TOKENS = 1024  # bounds the memory of a long clip


class CloudAutoencoder(Protocol):
    """What filling needs of an autoencoder. Times are real-valued model frames; points are metres in the world."""

    @property
    def points(self) -> int:
        """How many points the encoder was trained on."""
        ...

    def encode(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """(T, P, 3) and (P,) to latents (T, D) and centroids (T, 3)."""
        ...

    def decode(self, latents: Tensor, centroids: Tensor, times: Tensor, groups: Tensor, noise: Tensor) -> Tensor:
        """(T, D), (T, 3), (T,), (P,), (P, Z) to points (T, P, 3)."""
        ...

    def draw_noise(self, points: int, seed: int) -> Tensor:
        """Identities (P, Z) of points."""
        ...


class CloudModels(Protocol):
    """What filling needs of trained models."""

    @property
    def autoencoder(self) -> CloudAutoencoder: ...

    @property
    def glide(self) -> Glide:
        """How the plain interpolation that they were trained on goes on beyond the keys, seconds."""
        ...

    def synthesise(
        self, latents: Tensor, centroids: Tensor, known: Tensor, times: Tensor, base: tuple[Tensor, Tensor] | None
    ) -> tuple[Tensor, Tensor]:
        """Latents, centroids (read where known), (T,) True for keys, and those of the plain interpolation."""
        ...


@dataclass(frozen=True)
class Scene:
    """A clip to fill: its keys' plain interpolation at the N tokens, and (for measuring) the motion itself."""

    skeleton: Skeleton
    motion: Motion
    tokens: Tokens
    base: LocalPose

    @property
    def device(self) -> torch.device:
        return self.base.roots.device

    @property
    def times(self) -> Tensor:
        """(N,) float64 model frames."""
        return torch.as_tensor(self.tokens.times, device=self.device)

    @property
    def is_key(self) -> Tensor:
        """(N,) bool."""
        return torch.as_tensor(self.tokens.is_key, device=self.device)

    def base_world(self, rows: Tensor | slice) -> tuple[Tensor, Tensor]:
        """Heads (n, J, 3) and global rotations (n, J, 4) of the base at some tokens."""
        return self.base.rows(rows).world(self.skeleton.parents)


class DrawnPoints(NamedTuple):
    """Points drawn on a skeleton. Only `groups` goes to the models and the solve, never `bones`."""

    bones: Tensor  # (P,)
    in_bone: Tensor  # (P, 3)
    groups: Tensor  # (P,)


class Clouds(NamedTuple):
    """Where points should be and where the same points are on the base, and the bones they ride on.

    points:    (N, P, 3) metres.
    reference: (N, P, 3), or None where it is the bound points on the base themselves.
    binding:   the points' bones, found from positions and groups alone.
    """

    points: Tensor
    reference: Tensor | None
    binding: Binding


def draw_on_skeleton(
    skeleton: Skeleton, points: int, rng: np.random.Generator, sigma_m: float, device: torch.device | str = "cpu"
) -> DrawnPoints:
    """Points drawn on the sampled bones, each with probability proportional to its length."""
    lengths = np.linalg.norm(skeleton.tails, axis=-1) * skeleton.sampled
    drawn = draw_points(lengths, points, rng)
    bones, alphas, offsets = (torch.as_tensor(part, device=device) for part in drawn)
    tails = torch.as_tensor(skeleton.tails, dtype=torch.float32, device=device)
    groups = torch.as_tensor(skeleton.groups, device=device).long()[bones.long()]
    return DrawnPoints(bones, points_in_bone(tails, bones, alphas, offsets, sigma_m), groups)


def spread_on_skeleton(
    skeleton: Skeleton, points: int, start: float, sigma_m: float, device: torch.device | str = "cpu"
) -> DrawnPoints:
    """Points spread evenly over the sampled bones; `start` in [0, 1) tells one such spread from another."""
    tails = torch.as_tensor(skeleton.tails, dtype=torch.float32, device=device)
    lengths = tails.norm(dim=-1) * torch.as_tensor(skeleton.sampled, device=device)
    bones, alphas, offsets = spread_points(lengths, points, torch.tensor(start, device=device))
    groups = torch.as_tensor(skeleton.groups, device=device).long()[bones]
    return DrawnPoints(bones, points_in_bone(tails, bones, alphas, offsets, sigma_m), groups)


def place_on_pose(drawn: DrawnPoints, pose: LocalPose, skeleton: Skeleton) -> Tensor:
    """Drawn points (T, P, 3) on a pose, a chunk at a time."""
    parts = []
    for start in range(0, len(pose.roots), CHUNK_TOKENS):
        heads, rotations = pose.rows(slice(start, start + CHUNK_TOKENS)).world(skeleton.parents)
        parts.append(place_points(heads, rotations, drawn.bones, drawn.in_bone))
    return torch.cat(parts)


def find_clouds(
    scene: Scene,
    drawn: DrawnPoints,
    encoded: Sequence[DrawnPoints],
    models: CloudModels | None,
    source: CloudSource,
    seed: int,
    latents: tuple[Tensor, Tensor] | None = None,
) -> Clouds:
    """The cloud that the solve follows, and what it is compared with.

    Each view sees the clip turned about the vertical, every other one mirrored too; the models have learnt every
    heading and both hands, so what each view says is as good, and its error is largely its own. Each makes its share
    of the points that are followed, so that the solve takes their mean.

    Args:
        drawn: the points that are followed: as they are for the source "true", else as many decoded ones, of the same
            body groups.
        encoded: points to encode, one cloud for each view. For the source "latents" there is one view, of the means
            of their latents.
        models: None will do for the source "true".
        seed: of the decoded points' identities.
        latents: for the source "latents", (N, D) and centroids (N, 3) at the tokens.
    """
    groups = drawn.groups
    if models is None or source == "true":
        points = place_on_pose(drawn, _truth(scene), scene.skeleton)
        binding = bind_points(points[scene.is_key], groups, scene.skeleton, *scene.base_world(scene.is_key))
        return Clouds(points, None, binding)
    coder = models.autoencoder
    noise = coder.draw_noise(len(groups), seed)
    if source == "latents" and latents is not None:
        views = [View(0.0, False)]
        plain = [_encode_mean(coder, scene.base, encoded, scene.skeleton)]
        better = [latents]
    else:
        views = views_of(len(encoded))
        seen = list(zip(views, encoded, strict=True))
        plain = [view.encode(coder, scene.base, each, scene.skeleton) for view, each in seen]
        if source == "synthesised":
            better = [models.synthesise(*each, scene.is_key, scene.times, each) for each in plain]
        else:
            better = [view.encode(coder, _truth(scene), each, scene.skeleton) for view, each in seen]
    points, reference = (torch.zeros(len(scene.times), len(groups), 3, device=scene.device) for _ in range(2))
    for number, view in enumerate(views):
        own = slice(number, None, len(views))
        for out, given in ((points, better[number]), (reference, plain[number])):
            out[:, own] = view.decode(coder, given, scene.times, groups[own], noise[own]).to(scene.device)
    shown = torch.as_tensor(scene.tokens.spread(), device=scene.device)
    binding = bind_points(reference[shown], groups, scene.skeleton, *scene.base_world(shown))
    return Clouds(points, reference, binding)


class View(NamedTuple):
    """A way to look at a clip: turned by `yaw` radians about the vertical, then mirrored left to right or not."""

    yaw: float
    mirrored: bool

    def groups(self, groups: Tensor) -> Tensor:
        """The body groups as seen."""
        return torch.tensor(MIRRORED_GROUP, device=groups.device)[groups.long()] if self.mirrored else groups

    def encode(
        self, coder: CloudAutoencoder, pose: LocalPose, drawn: DrawnPoints, skeleton: Skeleton
    ) -> tuple[Tensor, Tensor]:
        """Latents (T, D) and centroids (T, 3), as seen, of drawn points on a pose."""
        points = turned(place_on_pose(drawn, pose, skeleton), torch.tensor(self.yaw))
        return coder.encode(self._sided(points), self.groups(drawn.groups))

    def decode(
        self, coder: CloudAutoencoder, given: tuple[Tensor, Tensor], times: Tensor, groups: Tensor, noise: Tensor
    ) -> Tensor:
        """Points (T, P, 3), turned back, of latents and centroids as seen."""
        made = coder.decode(*given, times, self.groups(groups), noise)
        return turned(self._sided(made), torch.tensor(-self.yaw))

    def _sided(self, points: Tensor) -> Tensor:
        return points * points.new_tensor([-1.0, 1.0, 1.0]) if self.mirrored else points


def views_of(count: int) -> list[View]:
    """Views evenly around the clip, every other one mirrored."""
    return [View(2 * math.pi * number / count, number % 2 == 1) for number in range(count)]


def _encode_mean(
    coder: CloudAutoencoder, pose: LocalPose, draws: Sequence[DrawnPoints], skeleton: Skeleton
) -> tuple[Tensor, Tensor]:
    """Latents (T, D) and centroids (T, 3) of a pose, means over the draws."""
    each = [coder.encode(place_on_pose(drawn, pose, skeleton), drawn.groups) for drawn in draws]
    latents, centroids = (torch.stack(parts).mean(0) for parts in zip(*each, strict=True))
    return latents, centroids


def _truth(scene: Scene) -> LocalPose:
    """The motion itself at the tokens. Only measurements may look at it."""
    frame_times = torch.arange(scene.motion.frames, device=scene.device).double() * (MODEL_FPS / scene.motion.fps)
    return pose_of_motion(scene.skeleton, scene.motion, scene.device).at(frame_times, scene.times)
