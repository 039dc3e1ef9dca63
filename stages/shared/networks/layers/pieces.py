"""Work over many rows, done a few rows at a time and done again in the backward pass.

Large intermediate results cost more than the arithmetic on them: on a CPU because memory is slower than the cores
(and fresh memory has to be given out by the system, page by page), on a GPU because they fill its memory. Computed in
pieces, they stay in the caches and are never stored; in return, the backward pass computes them a second time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor

# Values of the largest intermediate result of a piece: a few MiB, so that results of one operation are still in the
# cores' caches when the next reads them.
_CPU_VALUES = 2**20
# A GPU is fast only with much work at once, so pieces are used there only to save memory, with activation
# checkpointing.
_GPU_VALUES = 2**26
_ALL = 2**62


def rows_per_piece(device: torch.device, values_per_row: int, *, checkpointing: bool = False) -> int:
    """Number of rows of a piece, from the number of values in a row's largest intermediate result."""
    elsewhere = _GPU_VALUES if checkpointing else _ALL
    values = _CPU_VALUES * torch.get_num_threads() if device.type == "cpu" else elsewhere
    return max(1, values // max(1, values_per_row))


def in_pieces(
    run: Callable[..., Tensor],
    rows: int,
    parts: Sequence[Tensor],
    learnt: Sequence[Tensor],
    *,
    checkpointing: bool = False,
) -> Tensor:
    """`run(*parts)`, computed for `rows` rows of all parts at a time.

    Args:
        run: parts of n rows -> a tensor of n rows; each row of the result may depend only on the same row of the
            parts. It must give the same result when called again (no randomness of its own).
        rows: of a piece. If one covers all, `run` is called directly and autograd keeps its intermediate results,
            unless `checkpointing`, with which that piece is also computed again.
        parts: tensors with the same first dimension. learnt: every other tensor that `run` reads and that needs
            gradients (parameters, or results of earlier layers): the same tensor objects, not new views.

    Returns: what `run(*parts)` returns; gradients flow to the parts and to `learnt`.
    """
    if rows >= len(parts[0]) and not checkpointing:
        return run(*parts)
    return _Pieces.apply(run, rows, len(parts), *parts, *learnt)  # pyright: ignore[reportReturnType]


class _Pieces(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, run: Callable[..., Tensor], rows: int, count: int, *tensors: Tensor) -> Tensor:
        kind = tensors[0].device.type
        ctx.run, ctx.rows, ctx.count = run, rows, count
        ctx.autocast = (kind, torch.get_autocast_dtype(kind), torch.is_autocast_enabled(kind))
        ctx.save_for_backward(*tensors)
        parts = [part.detach() for part in tensors[:count]]
        with _autocast(ctx):
            return torch.cat([run(*piece) for piece in zip(*(part.split(rows) for part in parts), strict=True)])

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        parts, learnt = ctx.saved_tensors[: ctx.count], ctx.saved_tensors[ctx.count :]
        wanted = ctx.needs_input_grad[3:]
        own_wanted = wanted[: ctx.count]
        learning = [tensor for tensor, asked in zip(learnt, wanted[ctx.count :], strict=True) if asked]
        of_parts = [torch.empty_like(part) if asked else None for part, asked in zip(parts, own_wanted, strict=True)]
        sums: list[Tensor] = []
        begin = 0
        pieces = zip(*(part.split(ctx.rows) for part in parts), strict=True)
        with torch.enable_grad(), _autocast(ctx):
            for piece, grad in zip(pieces, grads[0].split(ctx.rows), strict=True):
                own = [part.detach().requires_grad_(asked) for part, asked in zip(piece, own_wanted, strict=True)]
                made = ctx.run(*own)
                asked_of = [part for part in own if part.requires_grad] + learning
                found = list(torch.autograd.grad(made, asked_of, grad))
                for whole in of_parts:
                    if whole is not None:
                        whole[begin : begin + len(grad)] = found.pop(0)
                sums = [one.add_(two) for one, two in zip(sums, found, strict=True)] if sums else found
                begin += len(grad)
        rest = iter(sums)
        of_learnt = [next(rest) if asked else None for asked in wanted[ctx.count :]]
        return None, None, None, *of_parts, *of_learnt


@contextmanager
def _autocast(ctx: Any) -> Iterator[None]:
    """The forward pass's autocast, around all pieces: weights are cast once for all. Casts made here without
    gradients must not be reused by layers that need gradients, nor the other way round."""
    kind, dtype, enabled = ctx.autocast
    torch.clear_autocast_cache()
    with torch.autocast(kind, dtype, enabled=enabled):
        yield
    torch.clear_autocast_cache()
