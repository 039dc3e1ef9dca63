"""The interface of a method that fills windows of one skeleton's poses: `fit` and `fill`.

A window's poses are vectors (B, T, D) in a `PoseSpace`. `fit` returns the loss of one training batch; the shared loop
takes the steps. `fill` returns the poses of all frames. Known frames are then put back, so no method can change them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from stages.shared.kinematics.rotations import aligned_signs
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.layers.sizes import MethodSizes


@dataclass(frozen=True)
class Paper:
    """Hyperparameters as a method's paper or its authors' code has them, and where they stand."""

    sizes: MethodSizes
    learning_rate: float
    batch: int
    source: str


@dataclass(frozen=True)
class Gaps:
    """B windows of T frames, of which some are known.

    poses:   (B, T, D) standardised pose vectors; 0 in frames that are not known.
    base:    (B, T, D) the plain interpolation of the known frames, equal to them there.
    known:   (B, T) bool, True = the frame is given.
    valid:   (B, T) bool, False = padding beyond a short clip, never known.
    times:   (1, T) frames at 30 Hz.
    offsets: (B, T, J, 3) bones' heads in their parents' frames, metres, interpolated like the base.
    """

    poses: Tensor
    base: Tensor
    known: Tensor
    valid: Tensor
    times: Tensor
    offsets: Tensor

    @property
    def missing(self) -> Tensor:
        """(B, T) bool, frames to fill."""
        return self.valid & ~self.known

    def with_keys(self, poses: Tensor) -> Tensor:
        """Poses (B, T, D) with the known frames put back."""
        return torch.where(self.known.unsqueeze(-1), self.poses, poses)

    def mean(self, errors: Tensor, frames: Tensor | None = None) -> Tensor:
        """The mean of errors (B, T, ...) over the missing frames, or over `frames` (B, T) bool."""
        chosen = (self.missing if frames is None else frames).to(errors.dtype)
        return (errors.flatten(2).mean(-1) * chosen).sum() / chosen.sum().clamp_min(1)


class Method(nn.Module, ABC):
    """A method. Subclasses set PAPER and are registered in `methods.py` or by an entry point.

    Args:
        space: the skeleton's pose space.
        sizes: of the network; every number of it is at least 1.

    `descends`: whether the method is a prior that gradient descent lowers, starting from the base; it then also
    denoises.
    """

    PAPER: ClassVar[Paper]
    descends: ClassVar[bool] = False

    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__()
        self.space, self.sizes = space, sizes

    @abstractmethod
    def fill(self, gaps: Gaps) -> Tensor:
        """The poses of all frames, (B, T, D) standardised; called without gradients in use. Known frames' values are
        not used."""

    def denoise(self, gaps: Gaps) -> Tensor:
        """The poses (B, T, D) of noisy motions, which are the base of gaps without known frames; of priors alone."""
        return self.fill(gaps)

    def fit(self, gaps: Gaps, truth: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """The training loss, a scalar, and numbers to log; by default `pose_loss` of what `fill` returns.

        Args:
            truth: (B, T, D) standardised poses of all frames.
            generator: for random draws.
        """
        loss = self.pose_loss(gaps, gaps.with_keys(self.fill(gaps)), truth)
        return loss, {}

    def pose_loss(self, gaps: Gaps, made: Tensor, truth: Tensor, frames: Tensor | None = None) -> Tensor:
        """L1 of global rotations plus L1 of global positions in metres, means over the missing frames or `frames`."""
        made_heads, made_turns = self.space.joints(made, gaps.offsets)
        heads, turns = self.space.joints(truth, gaps.offsets)
        turn_error = (aligned_signs(made_turns, turns) - turns).abs()
        return gaps.mean(turn_error, frames) + gaps.mean((made_heads - heads).abs(), frames)
