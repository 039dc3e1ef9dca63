"""Transition concepts (motion concepts 3.1.3): a CVAE from two anchors and a duration to the cubics between them.

Everything is relative to the first anchor: its pelvis is the origin and it faces +Z. The decoder's output is added to
the straight line between the anchors, so that an untrained network interpolates; the paper does not say how its
parameters are scaled.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from stages.shared.networks.concepts.motion_encoder import perceptron

POWERS = 4
_SAMPLES = 16  # moments at which the encoder sees a transition
OUTPUT_M = 0.1  # an output of 1 is this much


class Generated(NamedTuple):
    """splines (B, 4, F): coefficients of the powers 0 to 3 of the time 0 to 1. mean, log_variance (B, Z)."""

    splines: Tensor
    mean: Tensor
    log_variance: Tensor


class TransitionGenerator(nn.Module):
    """The CVAE of equation 3.

    Args:
        features: F = 3 J. latent: Z, the width of its code. hidden: width of its layers.
    """

    def __init__(self, features: int, latent: int = 32, hidden: int = 256):
        super().__init__()
        self.features, self.latent = features, latent
        self.encoder = perceptron(features * (2 + _SAMPLES) + 1, 2 * latent, hidden)
        self.decoder = perceptron(features * 2 + 1 + latent, POWERS * features, hidden)

    def forward(
        self, first: Tensor, last: Tensor, seconds: Tensor, frames: Tensor, counts: Tensor, noise: Tensor
    ) -> Generated:
        """Reconstruct transitions through their code.

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
        return Generated(
            self.decoded(first, last, seconds, mean + noise * (log_variance / 2).exp()), mean, log_variance
        )

    def decoded(self, first: Tensor, last: Tensor, seconds: Tensor, code: Tensor) -> Tensor:
        """Splines (B, 4, F) of codes (B, Z); codes drawn from the standard normal are samples of a transition."""
        found = self.decoder(torch.cat([first, last, seconds[:, None], code], dim=1)).unflatten(1, (POWERS, -1))
        return OUTPUT_M * found + straight(first, last)


def straight(first: Tensor, last: Tensor) -> Tensor:
    """(..., 4, F): the cubics that are the straight line from `first` to `last` (..., F)."""
    none = torch.zeros_like(first)
    return torch.stack([first, last - first, none, none], dim=-2)


def at_times(splines: Tensor, times: Tensor) -> Tensor:
    """Values (..., T, F) of splines (..., 4, F) at times (..., T) from 0 to 1."""
    return torch.stack([times**power for power in range(POWERS)], dim=-1) @ splines


def joint_distance(found: Tensor, true: Tensor) -> Tensor:
    """(...) mean over joints of the distances of features (..., 3 J): MPJPE of each frame, metres."""
    apart = (found - true).unflatten(-1, (-1, 3))
    return (apart.square().sum(-1) + 1e-12).sqrt().mean(-1)
