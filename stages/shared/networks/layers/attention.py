"""Attention over time with rotary positions (RoPE), and the layers built from it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F


def rotary_angles(times: Tensor, width: int, longest: float = 1000.0) -> tuple[Tensor, Tensor]:
    """Cosines and sines of RoFormer's angles at real-valued times.

    Args:
        times: (..., T) in model frames; need not be whole.
        width: of one attention head, even.
        longest: the base of the wavelengths' geometric series, in frames over 2 pi.

    Returns: two tensors (..., T, width / 2).
    """
    steps = torch.arange(0, width, 2, device=times.device, dtype=torch.float32) / width
    angles = times.float().unsqueeze(-1) * longest ** (-steps)
    return angles.cos(), angles.sin()


def rotate(values: Tensor, cosines: Tensor, sines: Tensor) -> Tensor:
    """Turn each pair (first half, second half) of the features by its angle: a rotation, so that the score of two
    frames depends only on the difference of their times.

    Args:
        values: (B, H, T, width). cosines, sines: (B or 1, T, width / 2).
    """
    first, second = values.chunk(2, dim=-1)
    cosines, sines = cosines.unsqueeze(1).to(values.dtype), sines.unsqueeze(1).to(values.dtype)
    turned = torch.addcmul(first * cosines, second, sines, value=-1), torch.addcmul(second * cosines, first, sines)
    return torch.cat(turned, dim=-1)


def sinusoids(times: Tensor, width: int) -> Tensor:
    """The original Transformer's absolute positions, (..., T, width): the alternative in PUMPS Table 2."""
    cosines, sines = rotary_angles(times, width, longest=10000.0)
    return torch.cat([sines, cosines], dim=-1)


class ExactNorm(nn.LayerNorm):
    """Layer norm in the precision of its parameters, for inputs of any precision.

    On a CPU, autocast leaves layer norms in bfloat16, where the parameters' gradients are summed in bfloat16 too:
    over tens of thousands of rows nearly all of the sum is lost. (On a GPU, autocast does the same as this function.)
    Without gradients nothing is lost: the kernel computes in float32 and rounds its result, as the next layer would.
    """

    def forward(self, input: Tensor) -> Tensor:
        if input.device.type == "cpu" and not torch.is_grad_enabled():
            return super().forward(input)
        return super().forward(input.to(self.weight.dtype))


def attend(query: Tensor, key: Tensor, value: Tensor, known: Tensor | None = None) -> Tensor:
    """Softmax attention, scaled by the root of the width: by the fused kernel, except if its backward pass is slow.

    On a CPU in bfloat16 the fused backward pass takes three (96 frames) to five times (24 frames) as long as plain
    products and a softmax, which AMX units multiply; without gradients, and in float32, the fused kernel is faster.

    Args:
        query: (B, H, T, width). key, value: (B, H, S, width).
        known: broadcast to (B, H, T, S). True: may be attended; or, in the queries' dtype, numbers that are added to
        the scores.

    Returns: (B, H, T, width).
    """
    if query.device.type != "cpu" or query.dtype != torch.bfloat16 or not torch.is_grad_enabled():
        return F.scaled_dot_product_attention(query, key, value, attn_mask=known)
    scores = (query * query.shape[-1] ** -0.5) @ key.transpose(-1, -2)
    if known is not None:
        scores = scores.masked_fill(~known, float("-inf")) if known.dtype == torch.bool else scores + known
    return scores.softmax(dim=-1) @ value


class Rows(NamedTuple):
    """Some frames of a batch of sequences, for layers that compute these alone.

    index: (N,) into all B * T frames. shape: (B, T).
    """

    index: Tensor
    shape: tuple[int, int]

    @staticmethod
    def where(chosen: Tensor) -> Rows:
        """The frames where (B, T) is True. Waits for the device."""
        return Rows(chosen.flatten().nonzero().squeeze(1), (chosen.shape[0], chosen.shape[1]))

    def take(self, values: Tensor) -> Tensor:
        """(B, T, C) -> (N, C)."""
        return values.flatten(0, 1).index_select(0, self.index)

    def put(self, values: Tensor) -> Tensor:
        """(N, C) -> (B, T, C), zero in all other frames."""
        whole = values.new_zeros(self.shape[0] * self.shape[1], values.shape[-1])
        return whole.index_copy(0, self.index, values).unflatten(0, self.shape)


class TimeAttention(nn.Module):
    """Multi-head attention over time with rotary positions.

    Args:
        width: of queries, keys and values. heads: must divide the width into even parts.
        rotary: if False, positions are not used here (they were added to the input).
    """

    def __init__(self, width: int, heads: int, rotary: bool = True):
        super().__init__()
        if width % heads or (width // heads) % 2:
            raise ValueError(f"width {width} does not split into {heads} heads of even width")
        self.heads, self.rotary = heads, rotary
        self.query = nn.Linear(width, width, bias=False)
        self.key_value = nn.Linear(width, 2 * width, bias=False)
        self.out = nn.Linear(width, width)

    def forward(
        self,
        frames: Tensor,
        times: Tensor,
        memory: Tensor | None = None,
        memory_times: Tensor | None = None,
        known: Tensor | None = None,
        rows: Rows | None = None,
        memory_rows: Rows | None = None,
    ) -> Tensor:
        """Args:
            frames: (B, T, width), the queries, at `times` (B or 1, T); with `rows` (N, width), those frames alone.
            memory: (B, S, width), the keys and values, at `memory_times`; the frames themselves by default. With
                `memory_rows` (M, width), those frames alone, the only ones that may be `known`.
            known: (B, S) True where the memory may be attended; None for everywhere. Every row needs one True.

        Returns: as the frames, (B, T, width) or (N, width).
        """
        if memory is None:
            memory, memory_rows = frames, rows
        memory_times = times if memory_times is None else memory_times
        asked, held = self.query(frames), self.key_value(memory)
        asked = asked if rows is None else rows.put(asked)
        held = held if memory_rows is None else memory_rows.put(held)
        query = self._split(asked)
        key, value = (self._split(part) for part in held.chunk(2, dim=-1))
        if self.rotary:
            width = query.shape[-1]
            angles = rotary_angles(times, width)
            query = rotate(query, *angles)
            key = rotate(key, *(angles if memory_times is times else rotary_angles(memory_times, width)))
        mask = None if known is None else known[:, None, None, :]
        mixed = attend(query, key, value, mask).transpose(1, 2).flatten(2)
        return self.out(mixed if rows is None else rows.take(mixed))

    def _split(self, values: Tensor) -> Tensor:
        batch, frames, width = values.shape
        return values.view(batch, frames, self.heads, width // self.heads).transpose(1, 2)


def clear_linear(layer: nn.Module) -> None:
    """Zero all of a linear layer's parameters."""
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)


class TimeLayer(nn.Module):
    """Pre-norm attention over time, then a feed-forward part; attends to the frames themselves, or to a memory."""

    def __init__(self, width: int, heads: int, rotary: bool = True, *, asks_memory: bool = False, widening: int = 4):
        super().__init__()
        self.attention_norm = ExactNorm(width)
        self.memory_norm = ExactNorm(width) if asks_memory else None
        self.attention = TimeAttention(width, heads, rotary)
        self.feed_norm = ExactNorm(width)
        self.feed = nn.Sequential(nn.Linear(width, widening * width), nn.GELU(), nn.Linear(widening * width, width))

    def begin_as_identity(self) -> None:
        """Make the layer the identity until it is trained, so that it can be added to trained layers."""
        for last in (self.attention.out, self.feed[-1]):
            clear_linear(last)

    def forward(
        self,
        frames: Tensor,
        times: Tensor,
        memory: Tensor | None = None,
        memory_times: Tensor | None = None,
        known: Tensor | None = None,
        rows: Rows | None = None,
        memory_rows: Rows | None = None,
    ) -> Tensor:
        """As `TimeAttention.forward`, with residuals; (B, T, width), or (N, width) with `rows`."""
        if (memory is None) != (self.memory_norm is None):
            raise ValueError("a layer made with asks_memory is given a memory at every call, and no other layer is")
        asked = None if memory is None or self.memory_norm is None else self.memory_norm(memory)
        normed = self.attention_norm(frames)
        frames = frames + self.attention(normed, times, asked, memory_times, known, rows, memory_rows)
        return frames + self.feed(self.feed_norm(frames))
