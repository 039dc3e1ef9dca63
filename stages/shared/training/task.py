"""The interface between the training loop and a network's training, and the random generators passed to it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from stages.shared.networks.layers.row_generator import RowGenerator, row_generator

Networks = TypeVar("Networks", bound=nn.Module)
HELD_BACK_SEED = 0  # seed of the validation windows: the same for trainings of all seeds


class RowRandom(np.random.Generator):
    """A generator for a whole batch and, in `rows`, one for each of its windows.

    Draws from a window's own generator do not depend on the other windows, so that a batch can be split into parts
    (for several devices, or to accumulate gradients) without changing it.

    step: of the training. numbers: the windows' indices in the whole batch.
    """

    rows: list[np.random.Generator]
    step: int
    numbers: tuple[int, ...]


class Drawer(Protocol):
    """Draws the batches of a training. It holds no network; one that works in another process is pickled."""

    def draw(self, rng: RowRandom) -> Any:
        """A batch of `len(rng.rows)` windows, drawn from `rng` only."""
        ...


class TrainingTask(ABC, Generic[Networks]):
    """One training: its networks, its batches, its loss and its validation."""

    networks: Networks

    @abstractmethod
    def drawer(self, *, elsewhere: bool = False) -> Drawer:
        """The object that draws batches, in a thread of this process or, with `elsewhere`, in other processes."""

    @abstractmethod
    def loss(self, batch: Any, generator: RowGenerator) -> tuple[Tensor, dict[str, Any]]:
        """The loss, a scalar tensor, and numbers (or scalar tensors) to log; `generator` is for draws inside the
        networks."""

    @abstractmethod
    def validate(self) -> dict[str, float]:
        """Scores on fixed validation windows; the first one selects the best weights (less is better)."""

    def splits(self) -> bool:
        """Whether a batch may be split into parts. Each window must then be drawn from its own generator, and the
        loss must be a mean over windows, or over the number that `weight` returns."""
        return False

    def weight(self, batch: Any, rows: int) -> float:
        """Weight of a part of `rows` windows in the whole batch's loss."""
        return float(rows)

    @property
    def keeps_last(self) -> bool:
        """Whether the last validation's weights are kept, whatever their score, instead of the best."""
        return False

    @property
    def keeps_both(self) -> bool:
        """Whether the last weights are kept beside the best ones."""
        return False

    def rate(self, step: int) -> float | None:
        """The learning rate at a step; None for that of the loop (`loop.learning_rate`)."""
        return None

    def draw(self, rng: RowRandom) -> Any:
        """A batch drawn in this process."""
        return self.drawer().draw(rng)


def step_seed(seed: int, purpose: int, step: int) -> np.random.Generator:
    """A generator for one purpose at one step, so that a resumed run draws the same as an uninterrupted one."""
    return np.random.default_rng((seed, purpose, step))


def step_random(seed: int, purpose: int, step: int, rows: Sequence[int]) -> RowRandom:
    """The generators of some windows of one step, given by their indices in the whole batch."""
    random = RowRandom(np.random.PCG64((seed, purpose, step)))
    random.rows = [np.random.default_rng((seed, purpose, step, row + 1)) for row in rows]
    random.step, random.numbers = step, tuple(rows)
    return random


def step_generator(seed: int, purpose: int, step: int, rows: Sequence[int], device: torch.device) -> RowGenerator:
    """A generator of one step for draws inside the networks."""
    words = ((seed, purpose, step), *((seed, purpose, step, row + 1) for row in rows))
    whole, *own = (int(np.random.SeedSequence(each).generate_state(1, np.uint64)[0] >> 1) for each in words)
    return row_generator(whole, own, device)


def rows_of(rng: np.random.Generator, count: int) -> list[np.random.Generator]:
    """`count` generators: the windows' own if `rng` has that many, else new ones seeded from `rng`."""
    rows = rng.rows if isinstance(rng, RowRandom) else []
    return rows if len(rows) == count else list(rng.spawn(count))
