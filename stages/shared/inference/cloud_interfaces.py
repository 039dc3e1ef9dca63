"""What the parts of filling give each other: the scene, how points are drawn on it, and their clouds; the interfaces
of trained models and of sources of clouds.

The models get positions, body groups and times; they do not get the bone that a point was drawn on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.confidence import Confidence
from stages.shared.inference.models import Span
from stages.shared.inference.token_times import Tokens
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.solve.binding import Binding
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
