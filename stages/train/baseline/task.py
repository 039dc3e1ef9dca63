"""Training any method of `networks/inbetween`: masked windows, the method's own loss, one validation for all."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from stages.shared.networks.inbetween.method import Method
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.inbetween.windows import filled_bones, gaps_of
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pcmrl.pose_interpolator import PoseWindows
from stages.shared.training.masks import draw_known
from stages.shared.training.pose_windows import (
    PoseBatch,
    one_hierarchy,
    pose_batch,
    shares_of_base,
    validation_batches,
)
from stages.shared.training.task import RowRandom, TrainingTask, step_seed
from stages.shared.training.windows import WindowPool
from stages.train.baseline.config import Config

_STATISTICS_WINDOWS = 64
_STATISTICS = 7  # the purpose of the generator


class MaskedDrawer:
    """Draws windows of poses with the masks of the three tasks, the same that the synthesiser is trained on."""

    def __init__(self, config: Config, pool: WindowPool):
        self.config, self.pool = config, pool

    def draw(self, rng: RowRandom) -> PoseBatch:
        config = self.config
        windows = self.pool.draw(len(rng.rows), config.window, rng, augment=config.augment)
        lengths = windows.valid.sum(1)
        return pose_batch(windows, draw_known(lengths, config.window, config.longest_gap, rng))


class BaselineTask(TrainingTask[Method]):
    """Training one method on one skeleton's poses."""

    def __init__(
        self, config: Config, method: type[Method], pool: WindowPool, held_back: WindowPool, device: torch.device
    ):
        self.config, self.device = config, device
        parents, groups = one_hierarchy(pool)
        one_hierarchy(held_back)
        self._drawer = MaskedDrawer(config, pool)
        torch.manual_seed(config.seed)
        space = PoseSpace(parents.tolist(), groups.tolist())
        space.set_statistics(_poses(space, pool, config))
        self.networks = method(space, config.network).to(device)
        self.held_back = validation_batches(held_back, config.window)

    def drawer(self, *, elsewhere: bool = False) -> MaskedDrawer:
        return self._drawer

    def loss(self, batch: PoseBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """The method's own loss."""
        batch = batch.to(self.device)
        truth, base = ((part.heads, part.rotations) for part in (batch.truth, batch.base))
        space = self.networks.space
        gaps, placed = gaps_of(space, truth, base, batch.known, batch.valid)
        with precision(self.device, self.config.mixed_precision):
            loss, figures = self.networks.fit(gaps, space.vectors(*truth, placed), generator)
        return loss, {name: value.detach() for name, value in figures.items()}

    def validate(self) -> dict[str, float]:
        """L2P and L2Q as shares of the plain interpolation's, for keys every 5, 15 and 30 frames; `score` is the mean
        of all."""
        shares: dict[str, float] = {}
        for every, batch in self.held_back:
            batch = batch.to(self.device)
            truth, base = ((part.heads, part.rotations) for part in (batch.truth, batch.base))
            made = filled_bones(self.networks, truth, base, batch.known, batch.valid)
            shares |= shares_of_base(PoseWindows(*made, batch.truth.tails), batch, every)
        return {"score": float(np.mean(list(shares.values()))), **shares}


def _poses(space: PoseSpace, pool: WindowPool, config: Config) -> Tensor:
    """(N, D) training poses, not standardised yet, of windows with evenly spaced keys."""
    windows = pool.draw(
        _STATISTICS_WINDOWS, config.window, step_seed(config.seed, _STATISTICS, 0), augment=config.augment
    )
    known = windows.valid & (torch.arange(config.window) % 15 == 0)
    placed = space.placement(windows.heads, known)
    return space.vectors(windows.heads, windows.rotations, placed)[windows.valid]
