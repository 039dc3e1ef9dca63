"""Layers in the manner of siMLPe (Guo et al. 2023): linear over joints or over time, layer norms, no activation.

A window is (B, T, C): T frames, C features of a frame.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn


def cosine_transform(frames: int) -> Tensor:
    """(T, T) orthonormal DCT-II matrix: its product with a signal is the signal's cosine transform."""
    times = (torch.arange(frames, dtype=torch.float64) + 0.5) * math.pi / frames
    matrix = torch.cos(torch.arange(frames, dtype=torch.float64).unsqueeze(1) * times) * math.sqrt(2 / frames)
    matrix[0] /= math.sqrt(2)
    return matrix.float()


class OverTime(nn.Module):
    """A linear layer over the frames, the same for every feature: (B, T, C) to (B, outputs, C)."""

    def __init__(self, frames: int, outputs: int):
        super().__init__()
        self.linear = nn.Linear(frames, outputs)

    def forward(self, window: Tensor) -> Tensor:
        return self.linear(window.transpose(1, 2)).transpose(1, 2)


class TimeBlock(nn.Module):
    """siMLPe's block: x + norm(linear over time(x)); its layer starts small, so that blocks start near identity."""

    def __init__(self, frames: int, features: int):
        super().__init__()
        self.over_time, self.norm = OverTime(frames, frames), nn.LayerNorm(features)
        nn.init.xavier_uniform_(self.over_time.linear.weight, gain=1e-8)
        nn.init.zeros_(self.over_time.linear.bias)

    def forward(self, window: Tensor) -> Tensor:
        return window + self.norm(self.over_time(window))


class Trunk(nn.Module):
    """A linear layer over the joints, blocks over time, a linear layer over the joints: (B, T, C) to (B, T, C)."""

    def __init__(self, frames: int, features: int, blocks: int):
        super().__init__()
        self.first, self.last = nn.Linear(features, features), nn.Linear(features, features)
        self.blocks = nn.Sequential(*(TimeBlock(frames, features) for _ in range(blocks)))

    def forward(self, window: Tensor) -> Tensor:
        return self.last(self.blocks(self.first(window)))


class Reduction(nn.Module):
    """(B, T, C) to a vector (B, t c), by a linear layer over the joints and one over time."""

    def __init__(self, frames: int, features: int, sizes: tuple[int, int]):
        super().__init__()
        times, kept = sizes
        self.over_joints, self.over_time = nn.Linear(features, kept), OverTime(frames, times)

    def forward(self, window: Tensor) -> Tensor:
        return self.over_time(self.over_joints(window)).flatten(1)


class Expansion(nn.Module):
    """The reverse of `Reduction`: a vector (B, t c), mixed by a linear layer, to (B, T, C)."""

    def __init__(self, frames: int, features: int, sizes: tuple[int, int]):
        super().__init__()
        self.sizes = sizes
        self.mixed = nn.Linear(sizes[0] * sizes[1], sizes[0] * sizes[1])
        self.over_joints, self.over_time = nn.Linear(sizes[1], features), OverTime(sizes[0], frames)

    def forward(self, latent: Tensor) -> Tensor:
        return self.over_time(self.over_joints(self.mixed(latent).unflatten(1, self.sizes)))


def factors(width: int) -> tuple[int, int]:
    """Two factors t >= c of a width, as near to each other as possible."""
    small = max(each for each in range(1, math.isqrt(width) + 1) if width % each == 0)
    return width // small, small
