"""The spectral autoencoder: the coefficients of one mesh to a latent, and back (SpecTrHuMS 3.2, SAE-LP).

Each layer of the encoder convolves along the list of coefficients, which is in the order of frequency, then shortens
the list by a learned matrix, then applies an activation. The decoder does the reverse. Input and output are
standardised per coefficient; the statistics are buffers.

The weights begin so that each layer keeps the size of its input. With PyTorch's own start each of the fourteen layers
makes it smaller, an untrained autoencoder returns one mesh for all inputs, and training spends its first hundreds of
steps on that.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.sizes import SpectralSizes


class LearnedPooling(nn.Module):
    """A matrix from `before` to `after` coefficients, the same for all channels: (B, C, before) to (B, C, after)."""

    def __init__(self, before: int, after: int):
        super().__init__()
        self.matrix = nn.Linear(before, after, bias=False)

    def forward(self, values: Tensor) -> Tensor:
        return self.matrix(values)


class SpectralAutoencoder(nn.Module):
    """Coefficients (B, k, 3) metres to latents (B, D) and back.

    Args:
        count: k.
        sizes: channels, pooling, convolution and latent are used.
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, count: int, sizes: SpectralSizes):
        super().__init__()
        self.count = count
        self.register_buffer("mean", torch.zeros(count, 3))
        self.register_buffer("deviation", torch.ones(count, 3))
        lengths = [count]
        for _ in sizes.channels:
            lengths.append(max(1, math.ceil(lengths[-1] / sizes.pooling)))
        channels, pad = [3, *sizes.channels], sizes.convolution // 2
        down, up = [], []
        for layer in range(len(sizes.channels)):
            down += [
                nn.Conv1d(channels[layer], channels[layer + 1], sizes.convolution, padding=pad),
                LearnedPooling(lengths[layer], lengths[layer + 1]),
                nn.ELU(),
            ]
            back = len(sizes.channels) - layer
            up += [
                LearnedPooling(lengths[back], lengths[back - 1]),
                nn.Conv1d(channels[back], channels[back - 1], sizes.convolution, padding=pad),
                *([nn.ELU()] if back > 1 else []),
            ]
        self.shape = (channels[-1], lengths[-1])
        flat = channels[-1] * lengths[-1]
        self.down, self.up = nn.Sequential(*down), nn.Sequential(*up)
        self.to_latent, self.from_latent = nn.Linear(flat, sizes.latent), nn.Linear(sizes.latent, flat)
        self.apply(_begin)

    def set_statistics(self, mean: Tensor, deviation: Tensor) -> None:
        """Set the mean and standard deviation (k, 3) of the training coefficients, metres."""
        self.mean.copy_(mean)
        # A coefficient that never varies has no scale of its own; the smallest of the others would blow up noise.
        self.deviation.copy_(deviation.clamp(min=float(deviation.max()) * 1e-4))

    def encode(self, coefficients: Tensor) -> Tensor:
        """Latents (..., D) of coefficients (..., k, 3) metres."""
        lead = coefficients.shape[:-2]
        standard = ((coefficients - self.mean) / self.deviation).reshape(-1, self.count, 3)
        return self.to_latent(self.down(standard.transpose(1, 2)).flatten(1)).reshape(*lead, -1)

    def decode(self, latents: Tensor) -> Tensor:
        """Coefficients (..., k, 3) metres of latents (..., D)."""
        lead = latents.shape[:-1]
        grown = self.from_latent(latents.reshape(-1, latents.shape[-1])).reshape(-1, *self.shape)
        standard = self.up(grown).transpose(1, 2)
        return (standard * self.deviation + self.mean).reshape(*lead, self.count, 3)

    def loss(self, made: Tensor, true: Tensor) -> Tensor:
        """Mean squared error of coefficients in metres, as a share of their variance over the training data.

        It is taken on destandardised coefficients, so that low frequencies, which vary most, count most (4.4).
        """
        return ((made - true) ** 2).mean() / (self.deviation**2).mean()


def _begin(module: nn.Module) -> None:
    """Weights of variance 1 / (inputs of an output), and no bias."""
    if isinstance(module, nn.Linear | nn.Conv1d):
        nn.init.normal_(module.weight, std=module.weight[0].numel() ** -0.5)
        if module.bias is not None:
            nn.init.zeros_(module.bias)
