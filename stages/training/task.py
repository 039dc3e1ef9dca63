"""What the training loop needs to know of a thing to train."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn


class Task(Protocol):
    """One training: its networks, its batches, its loss and its validation."""

    @property
    def networks(self) -> nn.Module: ...

    def draw(self, rng: np.random.Generator) -> Any:
        """A batch on the CPU, from `rng` alone; called in another thread, beside the step."""

    def loss(self, batch: Any, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """The scalar to descend and figures to log; `generator` is for draws inside the networks."""
        ...

    def validate(self) -> dict[str, float]:
        """Figures on held-back windows, always the same; the first is what the best is chosen by (less is better)."""
        ...


def step_seed(seed: int, purpose: int, step: int) -> np.random.Generator:
    """A generator for one purpose at one step: a resumed run draws what the unbroken one would have drawn."""
    return np.random.default_rng((seed, purpose, step))
