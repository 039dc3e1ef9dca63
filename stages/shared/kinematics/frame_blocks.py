"""Work on the frames of a long clip, a block of frames at a time, so that intermediate results take little memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from torch import Tensor

BLOCK_FRAMES = 1024


def blocks_of(frames: int, most: int | None = None) -> Iterator[slice]:
    """Slices of at most so many frames, by default `BLOCK_FRAMES`, that cover all, in order."""
    most = most or BLOCK_FRAMES
    return (slice(first, min(first + most, frames)) for first in range(0, frames, most))


def in_blocks(work: Callable[..., Tensor], *values: Tensor, most: int | None = None) -> Tensor:
    """`work(*values)`, computed for a block of frames at a time.

    Args:
        work: tensors of n frames -> one tensor of n frames; each frame of the result may depend only on the same
            frame of the values.
        values: tensors (T, ...).
    """
    frames = len(values[0])
    if frames <= (most or BLOCK_FRAMES):
        return work(*values)
    out: Tensor | None = None
    for rows in blocks_of(frames, most):
        made = work(*(value[rows] for value in values))
        if out is None:
            out = torch.empty(frames, *made.shape[1:], dtype=made.dtype, device=made.device)
        out[rows] = made
    assert out is not None
    return out
