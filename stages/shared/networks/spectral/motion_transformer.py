"""The motion transformer: a window of latents, unknown ones filled in plainly, to a window of latents (3.3)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.attention import sinusoids
from stages.shared.networks.layers.sizes import SpectralSizes


class MotionTransformer(nn.Module):
    """Latents (B, T, D) to latents (B, T, D), both standardised.

    Positions are a learned table that starts as sinusoids.

    Args:
        frames: T, the longest window. sizes: latent, heads, layers, feedforward and dropout are used.
    """

    def __init__(self, frames: int, sizes: SpectralSizes):
        super().__init__()
        width = sizes.latent
        even = width + width % 2
        table = sinusoids(torch.arange(frames, dtype=torch.float32), even)[:, :width]
        self.positions = nn.Parameter(table.clone())
        self.embed, self.out = nn.Linear(width, width), nn.Linear(width, width)
        layer = nn.TransformerEncoderLayer(
            width, sizes.heads, sizes.feedforward, sizes.dropout, activation="gelu", batch_first=True
        )
        self.layers = nn.TransformerEncoder(layer, sizes.layers, norm=nn.LayerNorm(width), enable_nested_tensor=False)

    def forward(self, latents: Tensor) -> Tensor:
        return self.out(self.layers(self.embed(latents) + self.positions[: latents.shape[1]]))


def filled_plainly(latents: Tensor, known: int, last: bool) -> Tensor:
    """The window (B, T, D) with its unknown latents filled in.

    Args:
        known: first frames that are known. last: whether the last frame is known too (completion): then unknown ones
            lie on the line between the last known frame and it. Without, they repeat the last known frame.
    """
    frames, held = latents.shape[1], latents[:, known - 1 : known]
    if not last:
        return torch.cat([latents[:, :known], held.expand(-1, frames - known, -1)], dim=1)
    share = torch.arange(1, frames - known + 1, device=latents.device, dtype=latents.dtype) / (frames - known)
    line = held + share[:, None] * (latents[:, -1:] - held)
    return torch.cat([latents[:, :known], line], dim=1)
