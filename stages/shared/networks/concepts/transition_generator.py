"""Transition concepts (motion concepts 3.1.3): a CVAE from two anchors and a duration to the cubics between them.

Everything is relative to the first anchor: its pelvis is the origin and it faces +Z. The decoder's output is added to
the straight line between the anchors, so that an untrained network interpolates; the paper does not say how its
parameters are scaled.

The paper's Table 9 compares splines with transitions that a network fits directly: there the decoder returns the pose
at a moment that it is given, instead of the parameters of a cubic.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from stages.shared.networks.concepts.motion_encoder import perceptron

POWERS = 4
_SAMPLES = 16  # moments at which the encoder sees a transition
OUTPUT_M = 0.1  # an output of 1 is this much
WAVES = 8  # numbers by which a network is told a moment


class Generated(NamedTuple):
    """code (B, Z): drawn from the normal distribution of mean and log_variance (B, Z)."""

    code: Tensor
    mean: Tensor
    log_variance: Tensor


class TransitionGenerator(nn.Module):
    """The CVAE of equation 3.

    Args:
        features: F = 3 J. latent: Z, the width of its code. hidden: width of its layers.
        splines: whether its transitions are cubics, or poses at given moments (Table 9).
    """

    def __init__(self, features: int, latent: int = 32, hidden: int = 256, *, splines: bool = True):
        super().__init__()
        self.features, self.latent, self.splines = features, latent, splines
        self.encoder = perceptron(features * (2 + _SAMPLES) + 1, 2 * latent, hidden)
        given, made = (0, POWERS * features) if splines else (WAVES, features)
        self.decoder = perceptron(features * 2 + 1 + latent + given, made, hidden)

    def forward(
        self, first: Tensor, last: Tensor, seconds: Tensor, frames: Tensor, counts: Tensor, noise: Tensor
    ) -> Generated:
        """The codes of transitions.

        Args:
            first, last: (B, F) anchors. seconds: (B,) duration. frames: (B, T, F), padded. counts: (B,) real frames.
            noise: (B, Z) standard normal.
        """
        share = torch.linspace(0, 1, _SAMPLES, device=frames.device)
        at = (share * (counts[:, None] - 1)).round().long()
        seen = torch.gather(frames, 1, at[..., None].expand(-1, -1, frames.shape[-1]))
        code = self.encoder(torch.cat([first, last, seen.flatten(1), seconds[:, None]], dim=1))
        mean, log_variance = code.chunk(2, dim=1)
        log_variance = log_variance.clamp(-12, 6)
        return Generated(mean + noise * (log_variance / 2).exp(), mean, log_variance)

    def decoded(self, first: Tensor, last: Tensor, seconds: Tensor, code: Tensor, times: Tensor) -> Tensor:
        """Transitions (B, T, F) of codes (B, Z) at times (B, T) from 0 to 1; codes drawn from the standard normal are
        samples of a transition."""
        given = torch.cat([first, last, seconds[:, None], code], dim=1)
        line = straight(first, last)
        if self.splines:
            return at_times(OUTPUT_M * self.decoder(given).unflatten(1, (POWERS, -1)) + line, times)
        moments = torch.cat([given[:, None].expand(-1, times.shape[1], -1), waves(times)], dim=-1)
        return OUTPUT_M * self.decoder(moments) + at_times(line, times)


def straight(first: Tensor, last: Tensor) -> Tensor:
    """(..., 4, F): the cubics that are the straight line from `first` to `last` (..., F)."""
    none = torch.zeros_like(first)
    return torch.stack([first, last - first, none, none], dim=-2)


def at_times(splines: Tensor, times: Tensor) -> Tensor:
    """Values (..., T, F) of splines (..., 4, F) at times (..., T) from 0 to 1."""
    return torch.stack([times**power for power in range(POWERS)], dim=-1) @ splines


def waves(times: Tensor) -> Tensor:
    """(..., 8) sines and cosines of times (...) from 0 to 1, of half a turn to two turns."""
    angles = math.pi * times[..., None] * torch.arange(1, WAVES // 2 + 1, device=times.device)
    return torch.cat([angles.sin(), angles.cos()], dim=-1)


def joint_distance(found: Tensor, true: Tensor) -> Tensor:
    """(...) mean over joints of the distances of features (..., 3 J): MPJPE of each frame, metres."""
    apart = (found - true).unflatten(-1, (-1, 3))
    return (apart.square().sum(-1) + 1e-12).sqrt().mean(-1)
