"""What the training loop needs to know of a thing to train, and the random generators that it hands to it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from stages.shared.networks.layers.row_generator import RowGenerator, row_generator

Networks = TypeVar("Networks", bound=nn.Module)
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


class Drawer(Protocol):
    """Draws the batches of a training. It holds no network; one that works in another process is pickled."""

    def draw(self, rng: RowRandom) -> Any:
        """A batch of `len(rng.rows)` windows, from `rng` alone."""
        ...


class Task(ABC, Generic[Networks]):
    """One training: its networks, its batches, its loss and its validation."""

    networks: Networks

    @abstractmethod
    def drawer(self, *, elsewhere: bool = False) -> Drawer:
        """What draws the batches: in a thread of this process or, with `elsewhere`, in processes of its own."""

    @abstractmethod
    def loss(self, batch: Any, generator: RowGenerator) -> tuple[Tensor, dict[str, Any]]:
        """The scalar to descend and figures (numbers or scalar tensors) to log; `generator` is for draws inside the
        networks."""

    @abstractmethod
    def validate(self) -> dict[str, float]:
        """Figures on held-back windows, always the same; the first is what the best is chosen by (less is better)."""

    def splits(self) -> bool:
        """Whether a batch may be cut into parts: each window is then drawn from its own generator, and the loss is a
        mean over windows, or over what `weight` counts."""
        return False

    def weight(self, batch: Any, rows: int) -> float:
        """How much a part of `rows` windows counts in the whole batch's loss."""
        return float(rows)

    def draw(self, rng: RowRandom) -> Any:
        """A batch drawn in this process."""
        return self.drawer().draw(rng)


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
