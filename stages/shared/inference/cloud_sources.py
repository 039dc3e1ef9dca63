"""The clouds of a fill: points on the plain interpolation, and the target positions of the same points.

A `CloudSource` finds them: `SynthesisedClouds` fills a file, `ReconstructedClouds` and `TrueClouds` use the true
motion and are for measurements, `GivenLatents` decodes stored latents. The models get positions, body groups and
times; they do not get the bone that a point was drawn on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.clouds import place_on_pose
from stages.shared.inference.confidence import Confidence
from stages.shared.inference.token_times import Tokens
from stages.shared.kinematics.conventions import MIRRORED_GROUP, MODEL_FPS
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.pointcloud.drawn_points import DrawnPoints, draw_on_skeleton, spread_on_skeleton
from stages.shared.pointcloud.heading import turned
from stages.shared.solve.binding import Binding, bind_points
from stages.shared.solve.skeleton_pose import SkeletonPose, pose_of_motion


class CloudAutoencoder(Protocol):
    """The interface that filling needs from an autoencoder. Times are real-valued model frames; points are metres in
    the world."""

    @property
    def points(self) -> int:
        """Number of points that the encoder was trained on."""
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
    """The interface that filling needs from trained models."""

    @property
    def autoencoder(self) -> CloudAutoencoder: ...

    @property
    def confidence(self) -> Confidence | None:
        """The confidence in their corrections; None if it was not calibrated."""
        ...

    @property
    def glide(self) -> Glide:
        """How the plain interpolation that they were trained on continues beyond the keys, seconds."""
        ...

    def synthesise(
        self, latents: Tensor, centroids: Tensor, known: Tensor, times: Tensor, base: tuple[Tensor, Tensor] | None
    ) -> tuple[Tensor, Tensor]:
        """Latents and centroids (read in known frames only), (T,) True for keys, and latents and centroids of the
        plain interpolation."""
        ...


@dataclass(frozen=True)
class Scene:
    """A clip to fill, in the form that the models and the solve use.

    tokens: the N times at which it is sampled.
    base:   the keys' plain interpolation at these times; at the keys it equals the keys.
    """

    tokens: Tokens
    base: SkeletonPose

    @property
    def skeleton(self) -> Skeleton:
        return self.base.skeleton

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

    def pose_of(self, motion: Motion) -> SkeletonPose:
        """Another motion of the same skeleton and frames at the N tokens."""
        frame_times = torch.arange(motion.frames, device=self.device).double() * (MODEL_FPS / motion.fps)
        return pose_of_motion(self.skeleton, motion, self.device).at(frame_times, self.times)


class Drawing(NamedTuple):
    """How points are drawn.

    points:  number of points of the cloud that the solve follows.
    sigma_m: spread of the points around the bones, metres.
    views:   number of views of the clip that the networks encode, turned and mirrored; each has new points spread
             over the bones, as many as the encoder was trained on.
    seed:    seed of the points' positions and identities.
    """

    points: int
    sigma_m: float
    views: int
    seed: int


class Clouds(NamedTuple):
    """Target positions of points, positions of the same points on the base, and the bones they are bound to.

    points:    (N, P, 3) metres.
    reference: (N, P, 3), or None if it equals the bound points on the base.
    binding:   the points' bones, found from positions and groups alone.
    """

    points: Tensor
    reference: Tensor | None
    binding: Binding


class CloudSource(Protocol):
    """Finds the clouds of a scene; there is one class for each way to compute them."""

    @property
    def exact(self) -> bool:
        """True if the points have no error."""
        ...

    @property
    def glide(self) -> Glide | None:
        """How the plain interpolation continues beyond the keys, seconds; None for the default."""
        ...

    @property
    def confidence(self) -> Confidence | None:
        """The confidence in corrections that come from these clouds; None if it was not calibrated."""
        ...

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        """The cloud that the solve follows, and the reference that it is compared with."""
        ...


@dataclass(frozen=True)
class SynthesisedClouds:
    """Clouds from trained models, which get only the keys."""

    models: CloudModels
    exact: bool = False

    @property
    def glide(self) -> Glide | None:
        return self.models.glide

    @property
    def confidence(self) -> Confidence | None:
        return self.models.confidence

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        coder = self.models.autoencoder
        seen = _views(coder, scene, drawing)
        plain = [view.encode(coder, scene.base, drawn, scene.skeleton) for view, drawn in seen]
        better = [self.models.synthesise(*each, scene.is_key, scene.times, each) for each in plain]
        return _decoded(coder, scene, drawing, [view for view, _ in seen], better, plain)


@dataclass(frozen=True)
class ReconstructedClouds:
    """The true motion's clouds, encoded and decoded, to measure the error of the autoencoder alone."""

    models: CloudModels
    truth: Motion
    exact: bool = False
    confidence: Confidence | None = None

    @property
    def glide(self) -> Glide | None:
        return self.models.glide

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        coder, truth = self.models.autoencoder, scene.pose_of(self.truth)
        seen = _views(coder, scene, drawing)
        plain, better = (
            [view.encode(coder, pose, drawn, scene.skeleton) for view, drawn in seen] for pose in (scene.base, truth)
        )
        return _decoded(coder, scene, drawing, [view for view, _ in seen], better, plain)


@dataclass(frozen=True)
class TrueClouds:
    """Points on the true motion, to measure the error of the solve alone."""

    truth: Motion
    exact: bool = True
    glide: Glide | None = None
    confidence: Confidence | None = None

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        drawn = _followed(scene, drawing)
        points = place_on_pose(drawn, scene.pose_of(self.truth), scene.skeleton)
        keys = scene.is_key
        binding = bind_points(points[keys], drawn.groups, scene.skeleton, *scene.base.rows(keys).world())
        return Clouds(points, None, binding)


@dataclass(frozen=True)
class GivenLatents:
    """Clouds decoded from given latents, one for each frame of a clip at 30 frames a second.

    They are compared with the decoded mean of the plain interpolation's latents over the views.

    latents: (T, D). centroids: (T, 3) metres.
    """

    autoencoder: CloudAutoencoder
    latents: Tensor
    centroids: Tensor
    glide: Glide | None = None
    exact: bool = False
    confidence: Confidence | None = None

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        """Raises UsageError if the number of latents is not the number of frames."""
        if scene.tokens.fps != MODEL_FPS or len(self.latents) != len(scene.tokens.times):
            raise UsageError(
                f"{len(self.latents)} latents do not fit a clip at {scene.tokens.fps:g} frames a second that is seen "
                f"at {len(scene.tokens.times)} times.",
                f"Give one latent for each frame of a motion at {MODEL_FPS:g} fps.",
            )
        coder = self.autoencoder
        draws = [drawn for _, drawn in _views(coder, scene, drawing)]
        each = [coder.encode(place_on_pose(drawn, scene.base, scene.skeleton), drawn.groups) for drawn in draws]
        latents, centroids = (torch.stack(parts).mean(0) for parts in zip(*each, strict=True))
        given = (self.latents, self.centroids)
        return _decoded(coder, scene, drawing, [View(0.0, False)], [given], [(latents, centroids)])


class View(NamedTuple):
    """A view of a clip: turned by `yaw` radians about the vertical, then mirrored left to right or not."""

    yaw: float
    mirrored: bool

    def groups(self, groups: Tensor) -> Tensor:
        """The body groups in this view."""
        return torch.tensor(MIRRORED_GROUP, device=groups.device)[groups.long()] if self.mirrored else groups

    def encode(
        self, coder: CloudAutoencoder, pose: SkeletonPose, drawn: DrawnPoints, skeleton: Skeleton
    ) -> tuple[Tensor, Tensor]:
        """Latents (T, D) and centroids (T, 3), in this view, of drawn points on a pose."""
        points = turned(place_on_pose(drawn, pose, skeleton), torch.tensor(self.yaw))
        return coder.encode(self._sided(points), self.groups(drawn.groups))

    def decode(
        self, coder: CloudAutoencoder, given: tuple[Tensor, Tensor], times: Tensor, groups: Tensor, noise: Tensor
    ) -> Tensor:
        """Points (T, P, 3), turned back to the world, of latents and centroids in this view."""
        made = coder.decode(*given, times, self.groups(groups), noise)
        return turned(self._sided(made), torch.tensor(-self.yaw))

    def _sided(self, points: Tensor) -> Tensor:
        return points * points.new_tensor([-1.0, 1.0, 1.0]) if self.mirrored else points


def views_of(count: int) -> list[View]:
    """Views evenly around the clip, every other one mirrored."""
    return [View(2 * math.pi * number / count, number % 2 == 1) for number in range(count)]


def _followed(scene: Scene, drawing: Drawing) -> DrawnPoints:
    """The points that the solve follows: the true ones, or as many decoded ones of the same body groups."""
    rng = np.random.default_rng(drawing.seed)
    return draw_on_skeleton(scene.skeleton, drawing.points, rng, drawing.sigma_m, scene.device)


def _views(coder: CloudAutoencoder, scene: Scene, drawing: Drawing) -> list[tuple[View, DrawnPoints]]:
    """Views of the clip, and for each the points that are encoded."""
    count = max(drawing.views, 1)
    starts = (np.arange(count) + 0.5) / count
    drawn = [spread_on_skeleton(scene.skeleton, coder.points, at, drawing.sigma_m, scene.device) for at in starts]
    return list(zip(views_of(count), drawn, strict=True))


def _decoded(
    coder: CloudAutoencoder,
    scene: Scene,
    drawing: Drawing,
    views: Sequence[View],
    better: Sequence[tuple[Tensor, Tensor]],
    plain: Sequence[tuple[Tensor, Tensor]],
) -> Clouds:
    """Decode each view's latents of the clip and of its plain interpolation.

    The models were trained on all headings and on mirrored motion, so every view is equally good, and the errors of
    the views are largely independent. Each view decodes its share of the followed points, so the solve takes their
    mean.

    Args:
        better, plain: latents (N, D) and centroids (N, 3) for each view, of the target and of the base.
    """
    groups = _followed(scene, drawing).groups
    noise = coder.draw_noise(len(groups), drawing.seed)
    points, reference = (torch.zeros(len(scene.times), len(groups), 3, device=scene.device) for _ in range(2))
    for number, view in enumerate(views):
        own = slice(number, None, len(views))
        for out, given in ((points, better[number]), (reference, plain[number])):
            out[:, own] = view.decode(coder, given, scene.times, groups[own], noise[own]).to(scene.device)
    shown = torch.as_tensor(scene.tokens.spread(), device=scene.device)
    binding = bind_points(reference[shown], groups, scene.skeleton, *scene.base.rows(shown).world())
    return Clouds(points, reference, binding)
