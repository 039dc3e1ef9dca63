"""Trainings of a few numbers, and a progress that ends a run as a kill would."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from stages.shared.training.config import TrainingConfig
from stages.shared.training.task import TrainingTask


class Killed(Exception):
    pass


class Bar:
    """A progress that keeps its total and how far it is."""

    def start(self, label: str, total: float | None = None) -> None:
        self.total, self.done = total, 0.0

    def advance(self, steps: float = 1, note: str = "") -> None:
        self.done += steps

    def message(self, text: str) -> None: ...


class KillAt:
    """Progress that breaks the run off after a step, as a kill would."""

    def __init__(self, step: int):
        self.left = step

    def start(self, label, total=None): ...
    def message(self, text): ...

    def advance(self, steps=1, note=""):
        if note:
            self.left -= 1
            if self.left == 0:
                raise Killed


class Parabola(TrainingTask[nn.ParameterDict]):
    """The smallest task: one parameter that should become 3."""

    def __init__(self, poison_at: int | None = None):
        self.networks = nn.ParameterDict({"place": nn.Parameter(torch.zeros(1))})
        self.steps, self.poison_at = 0, poison_at

    def drawer(self, *, elsewhere: bool = False) -> Parabola:
        return self

    def draw(self, rng: np.random.Generator) -> float:
        return float(rng.normal())

    def loss(self, batch, generator):
        self.steps += 1
        value = (self.networks["place"] - 3).square().sum()
        return value * (float("nan") if self.steps == self.poison_at else 1.0), {}

    def validate(self):
        return {"score": float((self.networks["place"].detach() - 3).square())}


def plain_config(tmp_path, **changes) -> TrainingConfig:
    return TrainingConfig(
        output=tmp_path / "out",
        **{"steps": 400, "learning_rate": 0.1, "warmup": 10, "validate_every": 20, "average": 0.5, **changes},
    )
