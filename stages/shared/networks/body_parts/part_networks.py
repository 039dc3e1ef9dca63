"""The four autoencoders of a body part's motion: AE, PAE, VAE, S-VAE (de Clermont Gallerande et al. 2025, 4.1.2).

All have the same trunk on each side (`mlp_layers`), which works on the cosine transform of a window over time. A
window holds two columns of each joint's rotation in its parent's frame, (B, T, K, 6).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from stages.shared.networks.body_parts import hyperspheres, phases
from stages.shared.networks.body_parts.mlp_layers import (
    Expansion,
    Reduction,
    Trunk,
    cosine_transform,
    factors,
)

COLUMNS = 6
_LEAST_VARIANCE, _MOST_VARIANCE = -10.0, 6.0  # logarithms


class PartNetwork(nn.Module, ABC):
    """An autoencoder of one part.

    Args:
        joints: K of the part. frames: T of a window. latent: the latent's width, at most; `width` is what is used.
        blocks: of each trunk. rate_hz: frames a second.
    """

    mean: Tensor
    transform: Tensor

    def __init__(self, joints: int, frames: int, latent: int, blocks: int, rate_hz: float):
        super().__init__()
        self.joints, self.frames, self.rate_hz = joints, frames, rate_hz
        self.width = self.width_of(latent)
        features = COLUMNS * joints
        self.encoder_trunk, self.decoder_trunk = (Trunk(frames, features, blocks) for _ in range(2))
        self.register_buffer("mean", torch.zeros(joints, COLUMNS))
        self.register_buffer("transform", cosine_transform(frames), persistent=False)
        self.build(frames, features)

    @staticmethod
    def width_of(latent: int) -> int:
        """The latent's width that the network can have, at most `latent`."""
        return latent

    @abstractmethod
    def build(self, frames: int, features: int) -> None:
        """Make the layers between the trunks."""

    @abstractmethod
    def coded(self, window: Tensor, generator: torch.Generator | None, sampled: bool) -> tuple[Tensor, Tensor]:
        """The latent (B, D) of what the encoder's trunk made of a window (B, T, C), and its divergence from the
        prior (B,) in nats, 0 for networks without one."""

    @abstractmethod
    def decoded(self, latent: Tensor) -> Tensor:
        """The window (B, T, C) that the decoder's trunk reads, of a latent (B, D)."""

    def encode(
        self, columns: Tensor, generator: torch.Generator | None = None, *, sampled: bool = False
    ) -> tuple[Tensor, Tensor]:
        """The latent (B, D) of windows (B, T, K, 6), and its divergence from the prior (B,).

        sampled: whether the latent is drawn from its distribution by `generator`; else it is the distribution's mean.
        """
        window = self.transform @ (columns - self.mean).flatten(2)
        return self.coded(self.encoder_trunk(window), generator, sampled)

    def decode(self, latent: Tensor) -> Tensor:
        """Columns (B, T, K, 6) of a latent (B, D); they need be neither unit nor at right angles."""
        window = self.transform.T @ self.decoder_trunk(self.decoded(latent))
        return window.unflatten(-1, (self.joints, COLUMNS)) + self.mean


class PlainNetwork(PartNetwork):
    """AE."""

    def build(self, frames: int, features: int) -> None:
        sizes = factors(self.width)
        self.reduction, self.expansion = Reduction(frames, features, sizes), Expansion(frames, features, sizes)

    def coded(self, window: Tensor, generator: torch.Generator | None, sampled: bool) -> tuple[Tensor, Tensor]:
        return self.reduction(window), window.new_zeros(len(window))

    def decoded(self, latent: Tensor) -> Tensor:
        return self.expansion(latent)


class PeriodicNetwork(PartNetwork):
    """PAE (Starke et al. 2022): channels over time, each reduced to the four parameters of a sine."""

    @staticmethod
    def width_of(latent: int) -> int:
        return max(latent // phases.PARAMETERS, 1) * phases.PARAMETERS

    def build(self, frames: int, features: int) -> None:
        channels = self.width // phases.PARAMETERS
        self.to_channels, self.of_channels = nn.Linear(features, channels), nn.Linear(channels, features)
        self.phases = phases.Phases(channels, frames, self.rate_hz)

    def coded(self, window: Tensor, generator: torch.Generator | None, sampled: bool) -> tuple[Tensor, Tensor]:
        signals = (self.transform.T @ self.to_channels(window)).transpose(1, 2)
        return self.phases(signals).flatten(1), window.new_zeros(len(window))

    def decoded(self, latent: Tensor) -> Tensor:
        signals = self.phases.signals(latent.unflatten(1, (-1, phases.PARAMETERS)))
        return self.of_channels(self.transform @ signals.transpose(1, 2))


class VariationalNetwork(PlainNetwork):
    """VAE: a Gaussian of each number of the latent, whose prior is the standard one."""

    def build(self, frames: int, features: int) -> None:
        super().build(frames, features)
        self.variances = Reduction(frames, features, factors(self.width))

    def coded(self, window: Tensor, generator: torch.Generator | None, sampled: bool) -> tuple[Tensor, Tensor]:
        mean = self.reduction(window)
        variance = self.variances(window).clamp(_LEAST_VARIANCE, _MOST_VARIANCE)  # its logarithm
        divergence = gaussian_divergence(mean, variance)
        if not sampled:
            return mean, divergence
        noise = torch.randn(mean.shape, generator=generator, device=mean.device, dtype=mean.dtype)
        return mean + (variance / 2).exp() * noise, divergence


class HypersphericalNetwork(PlainNetwork):
    """S-VAE (Davidson et al. 2018): channels on spheres, von Mises-Fisher, whose prior is uniform."""

    @staticmethod
    def width_of(latent: int) -> int:
        return max(latent // hyperspheres.NUMBERS, 1) * hyperspheres.NUMBERS

    def build(self, frames: int, features: int) -> None:
        super().build(frames, features)
        self.concentrations = nn.Linear(self.width, self.width // hyperspheres.NUMBERS)

    def coded(self, window: Tensor, generator: torch.Generator | None, sampled: bool) -> tuple[Tensor, Tensor]:
        flat = self.reduction(window)
        mean = nn.functional.normalize(flat.unflatten(1, (-1, hyperspheres.NUMBERS)), dim=-1)
        concentration = nn.functional.softplus(self.concentrations(flat)) + 1
        divergence = hyperspheres.divergence_from_uniform(concentration).sum(-1)
        latent = hyperspheres.sample(mean, concentration, generator) if sampled else mean
        return latent.flatten(1), divergence


def gaussian_divergence(mean: Tensor, log_variance: Tensor) -> Tensor:
    """Kullback-Leibler divergence (B,) in nats of Gaussians (B, D) from the standard one."""
    return 0.5 * (log_variance.exp() + mean.square() - 1 - log_variance).sum(-1)


NETWORKS: Mapping[str, type[PartNetwork]] = {
    "ae": PlainNetwork,
    "pae": PeriodicNetwork,
    "vae": VariationalNetwork,
    "svae": HypersphericalNetwork,
}
