"""The von Mises-Fisher distribution on the sphere in three dimensions, as the latent of an S-VAE (Davidson 2018).

Davidson et al. report that codes on one sphere of many dimensions collapse, and the body-part paper takes several
channels of few dimensions. Three are the fewest with a closed form for everything: samples by inverting the
distribution (no rejection), the mean, and the divergence from the uniform distribution.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

NUMBERS = 3  # of one channel
_SMALL = 1e-2  # concentrations below are computed by series, since their closed forms cancel


def mean_resultant(concentration: Tensor) -> Tensor:
    """Length of the mean of samples, coth k - 1 / k; of any shape."""
    safe = concentration.clamp_min(_SMALL)
    exact = 1 / torch.tanh(safe) - 1 / safe
    return torch.where(concentration < _SMALL, concentration / 3, exact)


def divergence_from_uniform(concentration: Tensor) -> Tensor:
    """Kullback-Leibler divergence from the uniform distribution on the sphere, in nats; of any shape.

    E[log q - log p] = k A(k) + log(k / (4 pi sinh k)) + log(4 pi) with A the mean resultant length.
    """
    safe = concentration.clamp_min(_SMALL)
    # log sinh k = k + log(1 - exp(-2 k)) - log 2, which does not overflow.
    log_sinh = safe + torch.log1p(-torch.exp(-2 * safe)) - math.log(2)
    exact = safe * mean_resultant(safe) + safe.log() - log_sinh
    return torch.where(concentration < _SMALL, concentration.square() / 6, exact)


def sample(mean: Tensor, concentration: Tensor, generator: torch.Generator | None) -> Tensor:
    """Exact samples (..., 3) on the unit sphere, differentiable in the mean and the concentration.

    The cosine w to the mean has the density k exp(k w) / (2 sinh k); its distribution is inverted. The direction
    across is uniform on the circle.

    Args:
        mean: (..., 3) unit. concentration: (...) positive. generator: of the draws.
    """
    shape = concentration.shape
    share, angle = torch.rand((2, *shape), generator=generator, device=mean.device, dtype=mean.dtype)
    safe = concentration.clamp_min(_SMALL)
    inverted = 1 + torch.log(share + (1 - share) * torch.exp(-2 * safe) + 1e-20) / safe
    cosine = torch.where(concentration < _SMALL, 2 * share - 1, inverted).clamp(-1, 1)
    sine = (1 - cosine.square()).clamp_min(1e-12).sqrt()
    across, other = _axes_across(mean)
    turn = (2 * math.pi * angle).unsqueeze(-1)
    return cosine.unsqueeze(-1) * mean + sine.unsqueeze(-1) * (turn.cos() * across + turn.sin() * other)


def _axes_across(mean: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors at right angles to unit vectors (..., 3) and to each other."""
    farthest = mean.abs().argmin(-1, keepdim=True)
    axis = torch.zeros_like(mean).scatter(-1, farthest, 1.0)
    across = torch.nn.functional.normalize(torch.linalg.cross(mean, axis, dim=-1), dim=-1)
    return across, torch.linalg.cross(mean, across, dim=-1)
