"""Running mean and standard deviation of vectors, by Welford's algorithm (SpecTrHuMS 4.4)."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class RunningMoments(nn.Module):
    """Mean and deviation (D,) of all vectors that were added, in the form for batches (Chan et al.).

    The latents of an encoder in training change, and vectors added early stay in the moments, as in the paper.
    """

    mean: Tensor
    squares: Tensor
    count: Tensor

    def __init__(self, width: int):
        super().__init__()
        self.register_buffer("mean", torch.zeros(width))
        self.register_buffer("squares", torch.ones(width))  # mean squared deviation
        self.register_buffer("count", torch.zeros((), dtype=torch.int64))

    @torch.no_grad()
    def add(self, vectors: Tensor) -> None:
        """Add vectors (..., D)."""
        rows = vectors.detach().reshape(-1, vectors.shape[-1]).to(self.mean.dtype)
        share = rows.shape[0] / (float(self.count) + rows.shape[0])
        mean = rows.mean(0)
        squares = ((rows - mean) ** 2).mean(0)
        apart = mean - self.mean
        self.squares.copy_((1 - share) * self.squares + share * squares + share * (1 - share) * apart**2)
        self.mean.add_(share * apart)
        self.count.add_(rows.shape[0])

    def standardise(self, vectors: Tensor) -> Tensor:
        """(vectors - mean) / deviation."""
        return (vectors - self.mean) / self._deviation()

    def restore(self, standard: Tensor) -> Tensor:
        """The reverse of `standardise`."""
        return standard * self._deviation() + self.mean

    def _deviation(self) -> Tensor:
        return (self.squares + 1e-8).sqrt()
