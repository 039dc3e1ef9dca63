"""A trained autoencoder that stays as it is while another network learns on its latents."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional

from stages.shared.networks.layers.device import precision
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder
from stages.shared.networks.pumps.frame_encoder import FrameEncoder

# Clouds encoded in one call: many for a GPU, on a CPU as many as fit in its caches.
_FRAMES_AT_ONCE = {"cuda": 32768}
_FRAMES_AT_ONCE_CPU = 4096

_LEAST_M = 0.005  # clouds nearer than this to the truth have little gradient
_LEAST_LATENT = 0.1
_UNIT_M = 0.05  # unit of clouds' distances in the loss, which makes them about as large as the latents'


class FrozenAutoencoder:
    """The encoder and the decoder on a training's device, without gradients of their own.

    window: frames of the decoder's training windows, and of the pieces in which it decodes.
    """

    def __init__(
        self, encoder: FrameEncoder, decoder: CloudDecoder, window: int, device: torch.device, mixed_precision: bool
    ):
        self.device, self.mixed_precision, self.window = device, mixed_precision, window
        self.encoder = encoder.to(device).eval().requires_grad_(False)
        self.decoder = decoder.to(device).eval().requires_grad_(False)

    def encode_frames(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """points (N, P, 3), groups (N, P) -> latents (N, D), centroids (N, 3); no gradient."""
        with torch.no_grad(), precision(self.device, self.mixed_precision):
            count = _FRAMES_AT_ONCE.get(self.device.type, _FRAMES_AT_ONCE_CPU)
            parts = [self.encoder(*part) for part in zip(points.split(count), groups.split(count), strict=True)]
        return torch.cat([latents for latents, _ in parts]), torch.cat([centroids for _, centroids in parts])

    def decode(self, latents: Tensor, centroids: Tensor, groups: Tensor, noise: Tensor) -> Tensor:
        """Clouds (B, T, P, 3) of latents (B, T, D), in pieces as long as the decoder was trained on."""
        batch, frames, _ = latents.shape
        length = min(self.window, frames)
        spare = -frames % length
        pieces = (frames + spare) // length
        latents, centroids = (
            functional.pad(part, (0, 0, 0, spare)).view(batch * pieces, length, -1) for part in (latents, centroids)
        )
        times = torch.arange(float(length), device=latents.device).unsqueeze(0)
        groups, noise = groups.repeat_interleave(pieces, 0), noise.repeat_interleave(pieces, 0)
        made = self.decoder(latents, centroids, times, groups, noise)
        return made.view(batch, pieces * length, -1, 3)[:, :frames]


def mean_squares(clouds: Tensor, others: Tensor) -> Tensor:
    """Mean over points of squared distances, (B, T) square metres, of clouds (B, T, P, 3)."""
    return (clouds - others).square().sum(-1).mean(-1)


def latent_errors(squares: Tensor, made: Tensor, latents: Tensor, wanted: Tensor) -> dict[str, Tensor]:
    """Mean errors over the wanted frames, scalars: `cloud`, in metres, and `latent`.

    Args:
        squares: (B, T) mean squared distances of decoded clouds from the true ones.
        made, latents: (B, T, D) latents of these clouds and of the true ones. wanted: (B, T) bool.
    """
    return {
        "cloud": _mean_root(squares, _LEAST_M, wanted),
        "latent": _mean_root((made - latents).square().mean(-1), _LEAST_LATENT, wanted),
    }


def latent_loss(errors: Mapping[str, Tensor], latent_weight: float) -> Tensor:
    """The loss of `latent_errors`, a scalar."""
    return errors["cloud"] / _UNIT_M + latent_weight * errors["latent"]


def _mean_root(square: Tensor, least: float, wanted: Tensor) -> Tensor:
    """Mean over the wanted frames (B, T) of the roots of mean squares (B, T); below `least` its slope falls to
    zero."""
    root = (square + least**2).sqrt() - least
    return (root * wanted).sum() / wanted.sum().clamp_min(1)
