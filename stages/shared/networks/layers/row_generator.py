"""Random draws inside the networks, by row: a part of a batch draws the same numbers as in the whole batch.

The rows' generators are on the CPU for every device, so that a seed draws the same numbers everywhere and a GPU does
not start hundreds of small kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from stages.shared.kinematics.device import onto


class RowGenerator(torch.Generator):
    """A generator for the whole batch and, in `rows`, one for each of its rows."""

    rows: list[torch.Generator]


def row_generator(seed: int, row_seeds: Sequence[int], device: torch.device) -> RowGenerator:
    """A generator seeded with `seed` on `device`, whose rows are seeded with `row_seeds`."""
    generator = RowGenerator(device=device)
    generator.manual_seed(seed)
    generator.rows = [torch.Generator().manual_seed(each) for each in row_seeds]
    return generator


def draw_normal(shape: Sequence[int], generator: torch.Generator | None, device: torch.device) -> Tensor:
    """Standard normal numbers; by row if the generator has rows."""
    return _draw(torch.randn, shape, generator, device)


def draw_uniform(shape: Sequence[int], generator: torch.Generator | None, device: torch.device) -> Tensor:
    """Numbers uniform on [0, 1); by row if the generator has rows."""
    return _draw(torch.rand, shape, generator, device)


def _draw(
    draw: Callable[..., Tensor], shape: Sequence[int], generator: torch.Generator | None, device: torch.device
) -> Tensor:
    if not isinstance(generator, RowGenerator):
        return draw(*shape, generator=generator, device=device)
    if len(generator.rows) != shape[0]:
        raise ValueError(f"{len(generator.rows)} rows' generators for {shape[0]} rows")
    return onto(torch.stack([draw(*shape[1:], generator=row) for row in generator.rows]), device)
