"""Compact networks from 2D keypoints to poses, to compare with.

They are in the manner of PoseFormer (Zheng et al. 2021), MixSTE (Zhang et al. 2022), MHFormer (Li et al. 2022) and
MotionBERT (Zhu et al. 2023).

Each keeps the idea of its paper and nothing else: sizes are small, all frames of a window are returned at once, time
has rotary positions, and the outputs are those of this project's pose tasks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.attention import ExactNorm, TimeLayer, clear_linear

CAMERA_FEATURES = 4  # after the points: the window's middle as a ray (2), log of its size in rays, 1 if known
SIZES: dict[str, dict[str, int]] = {
    "poseformer": {"width": 192, "point_width": 32, "space_layers": 2, "time_layers": 4, "heads": 4},
    "mixste": {"width": 64, "layers": 4, "heads": 4},
    "mhformer": {"width": 128, "point_width": 32, "hypotheses": 3, "time_layers": 2, "heads": 4},
    "motionbert": {"width": 64, "layers": 2, "heads": 4},
}


class _Points(nn.Module):
    """Features (B, T, F) as tokens (B, T, K, W), one a keypoint."""

    def __init__(self, features: int, width: int):
        super().__init__()
        self.count = (features - CAMERA_FEATURES) // 3
        self.embed = nn.Linear(3 + CAMERA_FEATURES, width)
        self.place = nn.Parameter(0.02 * torch.randn(self.count, width))

    def forward(self, features: Tensor) -> Tensor:
        points = features[..., :-CAMERA_FEATURES].unflatten(-1, (self.count, 3))
        camera = features[..., None, -CAMERA_FEATURES:].expand(*points.shape[:-1], -1)
        return self.embed(torch.cat([points, camera], dim=-1)) + self.place


class _Space(TimeLayer):
    """Attention among the keypoints of a frame; tokens (B, T, K, W)."""

    def __init__(self, width: int, heads: int):
        super().__init__(width, heads, rotary=False, widening=2)

    def forward(self, tokens: Tensor) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        flat = tokens.flatten(0, 1)
        return super().forward(flat, flat.new_zeros(1, flat.shape[1])).view_as(tokens)


class _Time(TimeLayer):
    """Attention over time, for each keypoint by itself; tokens (B, T, K, W)."""

    def __init__(self, width: int, heads: int):
        super().__init__(width, heads, widening=2)

    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, tokens: Tensor, times: Tensor, valid: Tensor | None
    ) -> Tensor:
        batch, frames, count, width = tokens.shape
        flat = tokens.transpose(1, 2).reshape(batch * count, frames, width)
        times = times.expand(batch, -1).repeat_interleave(count, 0)
        known = None if valid is None else valid.repeat_interleave(count, 0)
        return super().forward(flat, times, known=known).view(batch, count, frames, width).transpose(1, 2)


def _head(width: int, outputs: int) -> nn.Sequential:
    """A norm and a linear layer that is zero before training."""
    head = nn.Sequential(ExactNorm(width), nn.Linear(width, outputs))
    clear_linear(head[1])
    return head


class PoseFormerLike(nn.Module):
    """Attention among a frame's keypoints, then over time among frames, whose keypoints are one token."""

    def __init__(self, features: int, outputs: int, sizes: Mapping[str, int]):
        super().__init__()
        self.points = _Points(features, sizes["point_width"])
        self.space = nn.ModuleList(_Space(sizes["point_width"], sizes["heads"]) for _ in range(sizes["space_layers"]))
        self.join = nn.Linear(self.points.count * sizes["point_width"], sizes["width"])
        self.time = nn.ModuleList(TimeLayer(sizes["width"], sizes["heads"]) for _ in range(sizes["time_layers"]))
        self.out = _head(sizes["width"], outputs)

    def forward(self, features: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None) -> Tensor:
        """As every network of `stages.shared.pose_tasks.pose_network`."""
        tokens = self.points(features)
        for layer in self.space:
            tokens = layer(tokens)
        frames = self.join(tokens.flatten(2))
        for layer in self.time:
            frames = layer(frames, times, known=valid)
        return self.out(frames)


class MixSteLike(nn.Module):
    """Attention among keypoints and over time in turn, each keypoint with a track of its own to the end."""

    def __init__(self, features: int, outputs: int, sizes: Mapping[str, int]):
        super().__init__()
        width, heads = sizes["width"], sizes["heads"]
        self.points = _Points(features, width)
        self.space = nn.ModuleList(_Space(width, heads) for _ in range(sizes["layers"]))
        self.time = nn.ModuleList(_Time(width, heads) for _ in range(sizes["layers"]))
        self.out = _head(self.points.count * width, outputs)

    def forward(self, features: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None) -> Tensor:
        """As every network of `stages.shared.pose_tasks.pose_network`."""
        tokens = self.points(features)
        for space, time in zip(self.space, self.time, strict=True):
            tokens = time(space(tokens), times, valid)
        return self.out(tokens.flatten(2))


class MhFormerLike(nn.Module):
    """Several hypotheses of a frame, each from the one before; each refined over time, then by the others."""

    def __init__(self, features: int, outputs: int, sizes: Mapping[str, int]):
        super().__init__()
        width, narrow, heads, count = sizes["width"], sizes["point_width"], sizes["heads"], sizes["hypotheses"]
        self.points = _Points(features, narrow)
        self.space = nn.ModuleList(_Space(narrow, heads) for _ in range(count))
        self.join = nn.ModuleList(nn.Linear(self.points.count * narrow, width) for _ in range(count))
        self.own = nn.ModuleList(
            nn.ModuleList(TimeLayer(width, heads, widening=2) for _ in range(count))
            for _ in range(sizes["time_layers"])
        )
        self.other = nn.ModuleList(TimeLayer(width, heads, asks_memory=True, widening=2) for _ in range(count))
        self.out = _head(count * width, outputs)

    def forward(self, features: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None) -> Tensor:
        """As every network of `stages.shared.pose_tasks.pose_network`."""
        tokens, made = self.points(features), []
        for space, join in zip(self.space, self.join, strict=True):
            tokens = space(tokens)
            made.append(join(tokens.flatten(2)))
        for layers in self.own:
            made = [layer(each, times, known=valid) for layer, each in zip(layers, made, strict=True)]  # pyright: ignore[reportArgumentType]
        total = torch.stack(made).sum(0)
        made = [
            layer(each, times, memory=total - each, memory_times=times, known=valid)
            for layer, each in zip(self.other, made, strict=True)
        ]
        return self.out(torch.cat(made, dim=-1))


class MotionBertLike(nn.Module):
    """Two branches, space before time and time before space, mixed by weights that depend on both."""

    def __init__(self, features: int, outputs: int, sizes: Mapping[str, int]):
        super().__init__()
        width, heads, layers = sizes["width"], sizes["heads"], sizes["layers"]
        self.points = _Points(features, width)
        self.space = nn.ModuleList(_Space(width, heads) for _ in range(2 * layers))
        self.time = nn.ModuleList(_Time(width, heads) for _ in range(2 * layers))
        self.mix = nn.ModuleList(nn.Linear(2 * width, 2) for _ in range(layers))
        self.out = _head(self.points.count * width, outputs)

    def forward(self, features: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None) -> Tensor:
        """As every network of `stages.shared.pose_tasks.pose_network`."""
        tokens = self.points(features)
        for at, mix in enumerate(self.mix):
            one = self.time[2 * at](self.space[2 * at](tokens), times, valid)
            other = self.space[2 * at + 1](self.time[2 * at + 1](tokens, times, valid))
            share = mix(torch.cat([one, other], dim=-1)).softmax(dim=-1)
            tokens = share[..., :1] * one + share[..., 1:] * other
        return self.out(tokens.flatten(2))


LIFTERS = {
    "poseformer": PoseFormerLike,
    "mixste": MixSteLike,
    "mhformer": MhFormerLike,
    "motionbert": MotionBertLike,
}


def lifter(kind: str, features: int, outputs: int, settings: Mapping[str, Any]) -> nn.Module:
    """A network of one of these kinds; settings as in `SIZES`."""
    return LIFTERS[kind](features, outputs, {name: int(settings[name]) for name in SIZES[kind]})
