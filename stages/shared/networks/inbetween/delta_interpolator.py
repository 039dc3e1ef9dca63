"""The delta-interpolator (Oreshkin et al., Motion In-Betweening via Deep Delta-Interpolator, 2023).

The network's output is added to a plain interpolation, so that it learns only the difference. Keys are encoded by
self-attention; missing frames, each a positional encoding, attend to the encoded keys. Here the encoder and the
decoder have the same number of layers, and dropout is left out, since trainings are short.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.inbetween.method import Gaps, Method, Paper
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.layers.attention import ExactNorm, TimeLayer, clear_linear, sinusoids
from stages.shared.networks.layers.layer_stack import LayerStack
from stages.shared.networks.layers.sizes import MethodSizes

_RECONSTRUCTION = 1.0  # weight of the error of reconstructed keys, as in the authors' settings


class DeltaInterpolator(Method):
    """Differences to the plain interpolation, from encoded keys."""

    PAPER = Paper(
        MethodSizes(width=1024, layers=6, heads=8),
        learning_rate=2e-4,
        batch=64,
        source="boreshkinai/delta-interpolator, src/configs/transformer.yaml",
    )

    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__(space, sizes)
        self.embed = nn.Linear(space.width, sizes.width)
        self.missing_token = nn.Parameter(torch.randn(sizes.width) * 0.02)
        self.encoder = LayerStack(TimeLayer(sizes.width, sizes.heads, rotary=False) for _ in range(sizes.layers))
        self.decoder = LayerStack(
            TimeLayer(sizes.width, sizes.heads, rotary=False, asks_memory=True) for _ in range(sizes.layers)
        )
        self.norm = ExactNorm(sizes.width)
        self.out = nn.Linear(sizes.width, space.width)
        clear_linear(self.out)

    def fill(self, gaps: Gaps) -> Tensor:
        places = sinusoids(gaps.times, self.sizes.width)
        keys = self.encoder(self.embed(gaps.poses) + places, gaps.times, known=gaps.known)
        missing = (self.missing_token + places).expand_as(keys)
        missing = self.decoder(missing, gaps.times, memory=keys, memory_times=gaps.times, known=gaps.known)
        frames = torch.where(gaps.known.unsqueeze(-1), keys, missing)
        return gaps.base + self.out(self.norm(frames))

    def fit(self, gaps: Gaps, truth: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """L1 of rotations and positions in the gaps, and of the keys as the network reconstructs them."""
        made = self.fill(gaps)
        loss = self.pose_loss(gaps, made, truth)
        keys = self.pose_loss(gaps, made, truth, gaps.known)
        return loss + _RECONSTRUCTION * keys, {"keys": keys}
