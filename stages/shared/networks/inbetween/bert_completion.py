"""BERT-style motion completion (Duan et al., Single-Shot Motion Completion with Transformer, 2021 and 2022).

One transformer encoder over all frames. Its input is the sequence with its gaps filled by plain interpolation, put
through a convolution over time; to it are added positions and a learned embedding that says whether a frame is a key
or missing. Its output is the whole motion, not a difference.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.inbetween.method import Gaps, Method, Paper
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.layers.attention import ExactNorm, TimeLayer, sinusoids
from stages.shared.networks.layers.layer_stack import LayerStack
from stages.shared.networks.layers.sizes import MethodSizes


class BertCompletion(Method):
    """A transformer encoder over keys and interpolated frames."""

    PAPER = Paper(
        MethodSizes(width=256, layers=8, heads=8),
        learning_rate=1e-4,
        batch=64,
        source="PUMPS 4.2 names the adaptation; layers and heads are those of PUMPS' own attention",
    )

    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__(space, sizes)
        self.embed = nn.Conv1d(space.width, sizes.width, kernel_size=3, padding=1)
        self.kind = nn.Embedding(2, sizes.width)  # missing, key
        self.layers = LayerStack(TimeLayer(sizes.width, sizes.heads, rotary=False) for _ in range(sizes.layers))
        self.norm = ExactNorm(sizes.width)
        self.out = nn.Conv1d(sizes.width, space.width, kernel_size=3, padding=1)

    def fill(self, gaps: Gaps) -> Tensor:
        frames = self.embed(gaps.base.transpose(1, 2)).transpose(1, 2)
        frames = frames + sinusoids(gaps.times, self.sizes.width) + self.kind(gaps.known.long())
        frames = self.norm(self.layers(frames, gaps.times, known=gaps.valid))
        return self.out(frames.transpose(1, 2)).transpose(1, 2)

    def fit(self, gaps: Gaps, truth: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """L1 of the pose vectors, and of rotations and positions after forward kinematics, over all frames."""
        made = self.fill(gaps)
        vectors = gaps.mean((made - truth).abs(), gaps.valid)
        return vectors + self.pose_loss(gaps, made, truth, gaps.valid), {"vectors": vectors}
