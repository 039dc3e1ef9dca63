"""The clouds of a fill: points on the plain interpolation, and the target positions of the same points.

A `CloudSource` finds them: `SynthesisedClouds` fills a file, `ReconstructedClouds` and `TrueClouds` use the true
motion and are for measurements, `GivenLatents` decodes stored latents. The models get positions, body groups and
times; they do not get the bone that a point was drawn on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.clouds import BLOCK_TOKENS, place_on_pose
from stages.shared.inference.confidence import Confidence
from stages.shared.inference.models import Span, reach_of, touching
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

    def spans(self, frames: int) -> list[Span]:
        """The windows in which a clip of so many frames is decoded."""
        ...

    def decode(
        self,
        latents: Tensor,
        centroids: Tensor,
        times: Tensor,
        groups: Tensor,
        noise: Tensor,
        spans: Sequence[Span] | None = None,
    ) -> Tensor:
        """(T, D), (T, 3), (T,), (P,), (P, Z) to points (T, P, 3), in these windows."""
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

    def spans(self, known: Tensor) -> list[Span]:
        """The windows in which a clip with these keys, (T,) bool, is filled."""
        ...

    def synthesise(
        self,
        latents: Tensor,
        centroids: Tensor,
        known: Tensor,
        times: Tensor,
        base: tuple[Tensor, Tensor] | None,
        spans: Sequence[Span] | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Latents and centroids (read in known frames only), (T,) True for keys, latents and centroids of the plain
        interpolation, and windows in these frames."""
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


Pair = tuple[Tensor, Tensor]  # latents (n, D) and centroids (n, 3), metres


class Clouds(NamedTuple):
    """The bones that points are bound to, and the points' positions, which are made when they are asked for.

    binding: the points' bones, found from positions and groups alone.
    at:      first and last (excluded) token and (last - first,) bool, those that are needed -> target positions
             (last - first, P, 3), metres, and positions of the same points on the base, or None if these equal the
             bound points on the base. What stands in tokens that are not needed means nothing.
    """

    binding: Binding
    at: Callable[[int, int, np.ndarray], tuple[Tensor, Tensor | None]]


# A view's number, first and last (excluded) token, and whether better latents are wanted -> those of the target
# (without them, anything) and those of the base.
LatentsOf = Callable[[int, int, int, bool], tuple[Pair, Pair]]


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
        seen, is_key, times = _views(coder, scene, drawing), scene.is_key, scene.times
        windows = [
            span for span in self.models.spans(is_key) if not scene.tokens.is_key[span.start : span.stop].all()
        ]

        def latents_of(number: int, first: int, last: int, better: bool) -> tuple[Pair, Pair]:
            some = touching(windows, first, last) if better else []
            low, high = reach_of(some, first, last)
            plain = _encoded(coder, scene.base, *seen[number], low, high)
            made = plain
            if some:
                own = [span.moved(-low) for span in some]
                made = self.models.synthesise(*plain, is_key[low:high], times[low:high], plain, own)
            inner = slice(first - low, last - low)
            return (made[0][inner], made[1][inner]), (plain[0][inner], plain[1][inner])

        return _decoded(coder, scene, drawing, [view for view, _ in seen], latents_of)


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

        def latents_of(number: int, first: int, last: int, better: bool) -> tuple[Pair, Pair]:
            plain = _encoded(coder, scene.base, *seen[number], first, last)
            return (_encoded(coder, truth, *seen[number], first, last) if better else plain), plain

        return _decoded(coder, scene, drawing, [view for view, _ in seen], latents_of)


@dataclass(frozen=True)
class TrueClouds:
    """Points on the true motion, to measure the error of the solve alone."""

    truth: Motion
    exact: bool = True
    glide: Glide | None = None
    confidence: Confidence | None = None

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        drawn, truth = _followed(scene, drawing), scene.pose_of(self.truth)
        keys = scene.is_key
        points = place_on_pose(drawn, truth.rows(keys), scene.skeleton)
        binding = bind_points(points, drawn.groups, scene.skeleton, *scene.base.rows(keys).world())

        def points_at(first: int, last: int, needed: np.ndarray) -> tuple[Tensor, None]:
            return place_on_pose(drawn, truth.rows(slice(first, last)), scene.skeleton), None

        return Clouds(binding, points_at)


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
        coder, still = self.autoencoder, View(0.0, False)
        draws = [drawn for _, drawn in _views(coder, scene, drawing)]

        def latents_of(number: int, first: int, last: int, better: bool) -> tuple[Pair, Pair]:
            each = [_encoded(coder, scene.base, still, drawn, first, last) for drawn in draws]
            latents, centroids = (torch.stack(parts).mean(0) for parts in zip(*each, strict=True))
            return (self.latents[first:last], self.centroids[first:last]), (latents, centroids)

        return _decoded(coder, scene, drawing, [still], latents_of)


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
        self,
        coder: CloudAutoencoder,
        given: tuple[Tensor, Tensor],
        times: Tensor,
        groups: Tensor,
        noise: Tensor,
        spans: Sequence[Span] | None = None,
    ) -> Tensor:
        """Points (T, P, 3), turned back to the world, of latents and centroids in this view; in these windows."""
        made = coder.decode(*given, times, self.groups(groups), noise, spans)
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


def _encoded(
    coder: CloudAutoencoder, pose: SkeletonPose, view: View, drawn: DrawnPoints, first: int, last: int
) -> Pair:
    """Latents and centroids of drawn points on some tokens of a pose, in a view."""
    return view.encode(coder, pose.rows(slice(first, last)), drawn, pose.skeleton)


def _decoded(
    coder: CloudAutoencoder, scene: Scene, drawing: Drawing, views: Sequence[View], latents_of: LatentsOf
) -> Clouds:
    """Decode each view's latents of the clip and of its plain interpolation, as many tokens as are asked for.

    The models were trained on all headings and on mirrored motion, so every view is equally good, and the errors of
    the views are largely independent. Each view decodes its share of the followed points, so the solve takes their
    mean. Tokens are decoded in the windows of the whole clip, so points do not depend on which others are asked for.
    """
    groups = _followed(scene, drawing).groups
    noise = coder.draw_noise(len(groups), drawing.seed)
    total = len(scene.times)
    windows, times = coder.spans(total), scene.times

    def decoded(first: int, last: int, needed: np.ndarray, shown: np.ndarray) -> tuple[Tensor, Tensor]:
        """Points where they are `needed`, reference there and where it is `shown`: (last - first, P, 3) each."""
        some = [touching(windows, first, last, rows) for rows in (needed, needed | shown)]
        low, high = reach_of(some[1], first, last)
        points, reference = (torch.zeros(last - first, len(groups), 3, device=scene.device) for _ in range(2))
        inner = slice(first - low, last - low)
        for number, view in enumerate(views):
            own = slice(number, None, len(views))
            pairs = latents_of(number, low, high, bool(some[0]))
            for out, given, asked in zip((points, reference), pairs, some, strict=True):
                if asked:
                    spans = [span.moved(-low) for span in asked]
                    made = view.decode(coder, given, times[low:high], groups[own], noise[own], spans)
                    out[:, own] = made[inner].to(scene.device)
        return points, reference

    shown = scene.tokens.spread()
    nothing = np.zeros(total, bool)
    whole = total <= BLOCK_TOKENS
    if whole:  # found at once, and kept
        kept = decoded(0, total, scene.tokens.around_gaps(), np.isin(np.arange(total), shown))
        reference = kept[1][torch.as_tensor(shown, device=scene.device)]
    else:
        one = np.ones(1, bool)
        reference = torch.cat([decoded(at, at + 1, ~one, one)[1] for at in shown.tolist()])
    rows = torch.as_tensor(shown, device=scene.device)
    binding = bind_points(reference, groups, scene.skeleton, *scene.base.rows(rows).world())

    def points_at(first: int, last: int, needed: np.ndarray) -> tuple[Tensor, Tensor]:
        if whole:
            return kept[0][first:last], kept[1][first:last]
        return decoded(first, last, needed, nothing[first:last])

    return Clouds(binding, points_at)
