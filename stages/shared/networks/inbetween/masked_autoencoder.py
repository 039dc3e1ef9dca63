"""A masked autoencoder of poses (He et al., Masked Autoencoders Are Scalable Vision Learners, 2022), a frame a token.

The encoder sees known frames only. The decoder, shallower, sees the encoded frames and a learned token for each
missing one, and returns poses. The loss is the square of the error of missing frames' standardised vectors.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.inbetween.method import Gaps, Method, Paper
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.layers.attention import ExactNorm, TimeLayer, sinusoids
from stages.shared.networks.layers.layer_stack import LayerStack
from stages.shared.networks.layers.sizes import MethodSizes


class MaskedAutoencoder(Method):
    """An encoder of known frames and a decoder of all, as images' patches in the paper."""

    PAPER = Paper(
        MethodSizes(width=768, layers=12, heads=12),
        learning_rate=1.5e-4,
        batch=64,
        source="He et al. 2022, appendix A.1: ViT-B, base learning rate 1.5e-4, a decoder of 8 layers",
    )

    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__(space, sizes)
        decoding = max(1, round(sizes.layers * 8 / 12))
        self.embed = nn.Linear(space.width, sizes.width)
        self.encoder = LayerStack(TimeLayer(sizes.width, sizes.heads, rotary=False) for _ in range(sizes.layers))
        self.norm = ExactNorm(sizes.width)
        self.missing_token = nn.Parameter(torch.randn(sizes.width) * 0.02)
        self.decoder = LayerStack(TimeLayer(sizes.width, sizes.heads, rotary=False) for _ in range(decoding))
        self.out = nn.Sequential(ExactNorm(sizes.width), nn.Linear(sizes.width, space.width))

    def fill(self, gaps: Gaps) -> Tensor:
        places = sinusoids(gaps.times, self.sizes.width)
        seen = self.norm(self.encoder(self.embed(gaps.poses) + places, gaps.times, known=gaps.known))
        frames = torch.where(gaps.known.unsqueeze(-1), seen, self.missing_token) + places
        return self.out(self.decoder(frames, gaps.times, known=gaps.valid))

    def fit(self, gaps: Gaps, truth: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """The mean square error of the missing frames' vectors."""
        return gaps.mean((self.fill(gaps) - truth).square()), {}
