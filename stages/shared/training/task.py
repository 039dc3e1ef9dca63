"""What the training loop needs to know of a thing to train, and the random generators that it hands to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from stages.shared.networks.layers.row_generator import RowGenerator, row_generator

HELD_BACK_SEED = 0  # of the windows to validate on: trainings of other seeds are measured on the same ones


class RowRandom(np.random.Generator):
    """A generator for a whole batch and, in `rows`, one for each of its windows.

    What is drawn from a window's own generator does not depend on which other windows are drawn beside it, so that a
    batch may be cut into parts (for several devices, or to accumulate gradients) and stays the same batch.

    step: of the training. numbers: the windows' places in the whole batch.
    """

    rows: list[np.random.Generator]
    step: int
    numbers: tuple[int, ...]


class Task(Protocol):
    """One training: its networks, its batches, its loss and its validation.

    A task that says `splits = True` may be asked for parts of a batch: its `draw` makes `len(rng.rows)` windows, each
    from its own generator, and its loss is a mean over windows, or over what `weight(batch)` counts (optional).
    """

    @property
    def networks(self) -> nn.Module: ...

    def draw(self, rng: RowRandom) -> Any:
        """A batch on the CPU, from `rng` alone; called in another thread, or on a copy without networks in another
        process."""

    def loss(self, batch: Any, generator: RowGenerator) -> tuple[Tensor, dict[str, Any]]:
        """The scalar to descend and figures (numbers or scalar tensors) to log; `generator` is for draws inside the
        networks."""
        ...

    def validate(self) -> dict[str, float]:
        """Figures on held-back windows, always the same; the first is what the best is chosen by (less is better)."""
        ...


def step_seed(seed: int, purpose: int, step: int) -> np.random.Generator:
    """A generator for one purpose at one step: a resumed run draws what the unbroken one would have drawn."""
    return np.random.default_rng((seed, purpose, step))


def step_random(seed: int, purpose: int, step: int, rows: Sequence[int]) -> RowRandom:
    """The generators of some windows (by their number in the whole batch) of one step."""
    random = RowRandom(np.random.PCG64((seed, purpose, step)))
    random.rows = [np.random.default_rng((seed, purpose, step, row + 1)) for row in rows]
    random.step, random.numbers = step, tuple(rows)
    return random


def step_generator(seed: int, purpose: int, step: int, rows: Sequence[int], device: torch.device) -> RowGenerator:
    """The same for draws inside the networks."""
    words = ((seed, purpose, step), *((seed, purpose, step, row + 1) for row in rows))
    whole, *own = (int(np.random.SeedSequence(each).generate_state(1, np.uint64)[0] >> 1) for each in words)
    return row_generator(whole, own, device)


def rows_of(rng: np.random.Generator, count: int) -> list[np.random.Generator]:
    """`count` generators: the windows' own where `rng` has so many, or else new ones that follow from it."""
    rows = rng.rows if isinstance(rng, RowRandom) else []
    return rows if len(rows) == count else list(rng.spawn(count))
