"""Compact networks from noisy to clean frames, to compare with: a plain Transformer, and one in the manner of U-ViT.

They keep the idea of their papers (Vaswani et al. 2017; Bao et al. 2023) and nothing else: all frames of a window are
returned at once, and the outputs are those of this project's pose tasks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.attention import ExactNorm, TimeLayer, clear_linear, sinusoids

SIZES: dict[str, dict[str, int]] = {
    "transformer": {"width": 192, "layers": 8, "heads": 6},
    "u-vit": {"width": 192, "layers": 7, "heads": 6},
}


class PlainTransformer(nn.Module):
    """Layers of attention over time, with sinusoidal positions that are added to the input."""

    def __init__(self, features: int, outputs: int, sizes: Mapping[str, int]):
        super().__init__()
        width = sizes["width"]
        self.embed = nn.Linear(features, width)
        self.layers = nn.ModuleList(TimeLayer(width, sizes["heads"], rotary=False) for _ in range(sizes["layers"]))
        self.out = _head(width, outputs)

    def forward(self, features: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None) -> Tensor:
        """As `PoseTrunk.forward`."""
        frames = self.embed(features) + sinusoids(times, self.embed.out_features)
        for layer in self.layers:
            frames = layer(frames, times, known=valid)
        return self.out(frames)


class UVitLike(nn.Module):
    """An odd number of layers; each of the second half also gets the output of its counterpart in the first half, by
    a linear layer on both."""

    def __init__(self, features: int, outputs: int, sizes: Mapping[str, int]):
        super().__init__()
        width, half = sizes["width"], sizes["layers"] // 2
        self.embed = nn.Linear(features, width)
        self.down = nn.ModuleList(TimeLayer(width, sizes["heads"]) for _ in range(half))
        self.middle = TimeLayer(width, sizes["heads"])
        self.join = nn.ModuleList(nn.Linear(2 * width, width) for _ in range(half))
        self.up = nn.ModuleList(TimeLayer(width, sizes["heads"]) for _ in range(half))
        self.out = _head(width, outputs)

    def forward(self, features: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None) -> Tensor:
        """As `PoseTrunk.forward`."""
        frames, skipped = self.embed(features), []
        for layer in self.down:
            frames = layer(frames, times, known=valid)
            skipped.append(frames)
        frames = self.middle(frames, times, known=valid)
        for join, layer in zip(self.join, self.up, strict=True):
            frames = layer(join(torch.cat([frames, skipped.pop()], dim=-1)), times, known=valid)
        return self.out(frames)


DENOISERS = {"transformer": PlainTransformer, "u-vit": UVitLike}


def denoiser(kind: str, features: int, outputs: int, settings: Mapping[str, Any]) -> nn.Module:
    """A network of one of these kinds; settings as in `SIZES`."""
    return DENOISERS[kind](features, outputs, {name: int(settings[name]) for name in SIZES[kind]})


def _head(width: int, outputs: int) -> nn.Sequential:
    """Outputs of zero before training, so that learning starts from the base pose."""
    last = nn.Linear(width, outputs)
    clear_linear(last)
    return nn.Sequential(ExactNorm(width), last)
