"""The clouds of a fill: points on the plain interpolation, and the target positions of the same points.

A `CloudSource` finds them: `SynthesisedClouds` fills a file, `ReconstructedClouds` and `TrueClouds` use the true
motion and are for measurements, `GivenLatents` decodes stored latents.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion
from stages.shared.inference.cloud_interfaces import CloudAutoencoder, CloudModels, Clouds, Drawing, Pair, Scene
from stages.shared.inference.clouds import place_on_pose
from stages.shared.inference.confidence import Confidence
from stages.shared.inference.decoded_clouds import (
    View,
    corrected_in_windows,
    decoded_clouds,
    drawn_views,
    encoded_in_view,
    followed_points,
)
from stages.shared.inference.models import Span
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.solve.binding import bind_points


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
        seen, is_key, times = drawn_views(coder, scene, drawing), scene.is_key, scene.times
        windows = [
            span for span in self.models.spans(is_key) if not scene.tokens.is_key[span.start : span.stop].all()
        ]

        def corrected(plain: Pair, rows: slice, own: list[Span]) -> Pair:
            return self.models.synthesise(*plain, is_key[rows], times[rows], plain, own)

        latents_of = corrected_in_windows(coder, scene, seen, windows, corrected)
        return decoded_clouds(coder, scene, drawing, [view for view, _ in seen], latents_of)


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
        seen = drawn_views(coder, scene, drawing)

        def latents_of(number: int, first: int, last: int, better: bool) -> tuple[Pair, Pair]:
            plain = encoded_in_view(coder, scene.base, *seen[number], first, last)
            return (encoded_in_view(coder, truth, *seen[number], first, last) if better else plain), plain

        return decoded_clouds(coder, scene, drawing, [view for view, _ in seen], latents_of)


@dataclass(frozen=True)
class TrueClouds:
    """Points on the true motion, to measure the error of the solve alone."""

    truth: Motion
    exact: bool = True
    glide: Glide | None = None
    confidence: Confidence | None = None

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        drawn, truth = followed_points(scene, drawing), scene.pose_of(self.truth)
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
        draws = [drawn for _, drawn in drawn_views(coder, scene, drawing)]

        def latents_of(number: int, first: int, last: int, better: bool) -> tuple[Pair, Pair]:
            each = [encoded_in_view(coder, scene.base, still, drawn, first, last) for drawn in draws]
            latents, centroids = (torch.stack(parts).mean(0) for parts in zip(*each, strict=True))
            return (self.latents[first:last], self.centroids[first:last]), (latents, centroids)

        return decoded_clouds(coder, scene, drawing, [still], latents_of)
