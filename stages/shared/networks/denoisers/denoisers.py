"""Compact networks from noisy poses to clean ones, to compare with: a plain Transformer and a U-ViT.

They are the denoisers that text-to-motion diffusion uses (Vaswani et al. 2017; Bao et al. 2023, as Chen et al. 2023
use it), without the diffusion: a window of features in, the outputs of all its frames at once. Time has rotary
positions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.attention import ExactNorm, TimeLayer, clear_linear

SIZES: dict[str, dict[str, int]] = {
    "transformer": {"width": 192, "layers": 6, "heads": 6},
    "u-vit": {"width": 192, "layers": 6, "heads": 6},
}


class _Denoiser(nn.Module):
    """What both share: a linear layer before the layers, and one that is zero before training after them."""

    def __init__(self, features: int, outputs: int, sizes: Mapping[str, int]):
        super().__init__()
        width = sizes["width"]
        self.join = nn.Linear(features, width)
        self.layers = nn.ModuleList(TimeLayer(width, sizes["heads"]) for _ in range(sizes["layers"]))
        self.out = nn.Sequential(ExactNorm(width), nn.Linear(width, outputs))
        clear_linear(self.out[1])

    def through(self, frames: Tensor, times: Tensor, valid: Tensor | None) -> Tensor:
        """Frames (B, T, W) after the layers."""
        for layer in self.layers:
            frames = layer(frames, times, known=valid)
        return frames

    def forward(self, features: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None) -> Tensor:
        """As every network of `stages.shared.pose_tasks.pose_network`."""
        return self.out(self.through(self.join(features), times, valid))


class Transformer(_Denoiser):
    """Layers of attention over time, one after the other."""


class UVitLike(_Denoiser):
    """The same layers with long skips: the last layer also reads the output of the first, the one before it
    that of the second, and so on."""

    def __init__(self, features: int, outputs: int, sizes: Mapping[str, int]):
        super().__init__(features, outputs, sizes)
        width = sizes["width"]
        self.skips = nn.ModuleList(nn.Linear(2 * width, width) for _ in range(sizes["layers"] // 2))

    def through(self, frames: Tensor, times: Tensor, valid: Tensor | None) -> Tensor:
        half = len(self.skips)
        kept: list[Tensor] = []
        for at, layer in enumerate(self.layers):
            if at >= len(self.layers) - half:
                skip = self.skips[at - len(self.layers) + half]
                frames = skip(torch.cat([frames, kept.pop()], dim=-1))
            frames = layer(frames, times, known=valid)
            if at < half:
                kept.append(frames)
        return frames


DENOISERS = {"transformer": Transformer, "u-vit": UVitLike}


def denoiser(kind: str, features: int, outputs: int, settings: Mapping[str, Any]) -> nn.Module:
    """A network of one of these kinds; settings as in `SIZES`."""
    return DENOISERS[kind](features, outputs, {name: int(settings[name]) for name in SIZES[kind]})
