"""The noise of the paper's 4.2.2: small random turns of the input, latent numbers set to zero; and tampered parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.rotations import from_turn_vectors, multiply


def with_input_noise(local: Tensor, noise_deg: float, generator: torch.Generator) -> Tensor:
    """Local rotations (N, T, B, 4), each turned by a vector whose three parts are normal with this deviation."""
    turns = torch.randn((*local.shape[:-1], 3), generator=generator) * float(np.radians(noise_deg))
    return multiply(local, from_turn_vectors(turns))


def with_zeros(latents: Sequence[Tensor], share: float, generator: torch.Generator) -> list[Tensor]:
    """Latents (N, D) of the parts; of each window's numbers, over all parts, this share is set to zero."""
    whole = torch.cat(list(latents), dim=1)
    count = round(share * whole.shape[1])
    order = torch.rand(whole.shape, generator=generator).argsort(dim=1)
    zeroed = whole.scatter(1, order[:, :count].to(whole.device), 0.0)
    return list(zeroed.split([each.shape[1] for each in latents], dim=1))


def tampered_slices(widths: Sequence[int], pieces: int) -> list[tuple[int, slice]]:
    """What is tampered with, one after another: each part's latent, or equal pieces of the only part's.

    Returns: the part's index, and the slice of its latent.
    """
    if len(widths) > 1:
        return [(index, slice(0, width)) for index, width in enumerate(widths)]
    bounds = [round(piece * widths[0] / pieces) for piece in range(pieces + 1)]
    return [(0, slice(bounds[piece], bounds[piece + 1])) for piece in range(pieces)]


def with_tampering(
    latents: Sequence[Tensor], index: int, piece: slice, amount: float, generator: torch.Generator
) -> list[Tensor]:
    """Latents with normal noise on a slice of one part's, in deviations of its numbers over the windows."""
    out = [each.clone() for each in latents]
    chosen = out[index][:, piece]
    noise = torch.randn(chosen.shape, generator=generator).to(chosen.device)
    out[index][:, piece] = chosen + amount * chosen.std(dim=0, correction=0) * noise
    return out
