"""Attention over time with learned relative positions (Shaw et al. 2018), zero before training (PC-MRL 3.4).

PC-MRL uses these instead of CITL's sinusoids. A table holds one vector for each whole distance between two frames;
the product of the query and the distance's vector is added to the score. With a table of zeros, it is attention
without positions. Nothing depends on the beginning of a window, and a window may be longer than those in training:
distances beyond the table count as its longest.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.attention import ExactNorm, attend


class RelativeAttention(nn.Module):
    """Multi-head attention whose scores are q_i . (k_j + a_(t_j - t_i)) / sqrt(width of a head).

    The vectors of distances that are not whole are interpolated linearly, so times may be any real numbers. Only keys
    carry relative positions (Shaw et al. found that those of the values gain nothing).

    Args:
        width: of queries, keys and values. heads: must divide the width.
        longest: distances are clipped to this many frames on either side.
    """

    def __init__(self, width: int, heads: int, longest: int = 64):
        super().__init__()
        if width % heads:
            raise ValueError(f"width {width} does not split into {heads} heads")
        self.heads, self.longest = heads, longest
        self.query = nn.Linear(width, width, bias=False)
        self.key_value = nn.Linear(width, 2 * width, bias=False)
        self.distances = nn.Parameter(torch.zeros(2 * longest + 1, width // heads))
        self.out = nn.Linear(width, width)

    def forward(
        self,
        frames: Tensor,
        times: Tensor,
        memory: Tensor | None = None,
        memory_times: Tensor | None = None,
        known: Tensor | None = None,
    ) -> Tensor:
        """Args:
            frames: (B, T, width), the queries, at `times` (B or 1, T).
            memory: (B, S, width), the keys and values, at `memory_times`; the frames themselves by default.
            known: (B, S) True where the memory may be attended; None for everywhere. Every row needs one True.

        Returns: (B, T, width).
        """
        memory = frames if memory is None else memory
        memory_times = times if memory_times is None else memory_times
        query = self._split(self.query(frames))
        key, value = (self._split(part) for part in self.key_value(memory).chunk(2, dim=-1))
        bias = self._position_scores(query, times, memory_times) * query.shape[-1] ** -0.5
        if known is not None:
            bias = bias.masked_fill(~known[:, None, None, :], float("-inf"))
        mixed = attend(query, key, value, bias)
        return self.out(mixed.transpose(1, 2).flatten(2))

    def _position_scores(self, query: Tensor, times: Tensor, memory_times: Tensor) -> Tensor:
        """q_i . a_(t_j - t_i), (B, heads, T, S), of queries (B, heads, T, width of a head)."""
        every = query @ self.distances.to(query.dtype).T
        apart = memory_times.unsqueeze(-2) - times.unsqueeze(-1)
        place = apart.to(query.dtype if query.dtype == torch.float64 else torch.float32)
        place = place.clamp(-self.longest, self.longest) + self.longest
        below = place.floor().long().clamp(max=2 * self.longest)
        share = (place - below).to(query.dtype).unsqueeze(1)
        shape = (query.shape[0], self.heads, *below.shape[-2:])
        scores = every.gather(-1, below.unsqueeze(1).expand(shape))
        if bool((share > 0).any()):
            above = (below + 1).clamp(max=2 * self.longest)
            scores = torch.lerp(scores, every.gather(-1, above.unsqueeze(1).expand(shape)), share.expand(shape))
        return scores

    def _split(self, values: Tensor) -> Tensor:
        batch, frames, width = values.shape
        return values.view(batch, frames, self.heads, width // self.heads).transpose(1, 2)


class RelativeLayer(nn.Module):
    """Pre-norm `RelativeAttention`, then a feed-forward part; attends to the frames themselves, or to a memory."""

    def __init__(self, width: int, heads: int, longest: int = 64, *, asks_memory: bool = False, widening: int = 4):
        super().__init__()
        self.attention_norm = ExactNorm(width)
        self.memory_norm = ExactNorm(width) if asks_memory else None
        self.attention = RelativeAttention(width, heads, longest)
        self.feed_norm = ExactNorm(width)
        self.feed = nn.Sequential(nn.Linear(width, widening * width), nn.GELU(), nn.Linear(widening * width, width))

    def forward(
        self, frames: Tensor, times: Tensor, memory: Tensor | None = None, known: Tensor | None = None
    ) -> Tensor:
        """As `RelativeAttention.forward`, with residuals, the memory at the frames' own times; (B, T, width)."""
        if (memory is None) != (self.memory_norm is None):
            raise ValueError("a layer made with asks_memory is given a memory at every call, and no other layer is")
        asked = None if memory is None or self.memory_norm is None else self.memory_norm(memory)
        frames = frames + self.attention(self.attention_norm(frames), times, asked, known=known)
        return frames + self.feed(self.feed_norm(frames))
