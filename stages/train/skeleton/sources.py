"""Windows of motion from several `tpc` artefacts, of any mix of skeletons."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from data_schemas.errors import InputError
from data_schemas.tpc import TpcReader
from stages.shared.training.config import TrainingConfig
from stages.shared.training.task import RowRandom, rows_of
from stages.shared.training.windows import WindowPool, Windows


class MixedPool:
    """Several pools as one; each artefact has an equal share of the windows."""

    def __init__(self, pools: Sequence[WindowPool]):
        self.pools = list(pools)

    def draw(
        self, batch: int, window: int, rng: np.random.Generator, *, augment: bool, proportions: float = 1.0
    ) -> Windows:
        """As `WindowPool.draw`; each window's artefact is also drawn from the window's own generator."""
        if len(self.pools) == 1:
            return self.pools[0].draw(batch, window, rng, augment=augment, proportions=proportions)
        rows = rows_of(rng, batch)
        chosen = np.array([int(row.integers(len(self.pools))) for row in rows])
        drawn, order = [], []
        for index, pool in enumerate(self.pools):
            mine = np.flatnonzero(chosen == index)
            if len(mine):
                own = RowRandom(np.random.PCG64(0))  # only its rows are drawn from
                own.rows = [rows[row] for row in mine]
                drawn.append(pool.draw(len(mine), window, own, augment=augment, proportions=proportions))
                order.append(mine)
        return joined(drawn, np.argsort(np.concatenate(order)))


def pools_of(readers: Sequence[TpcReader], config: TrainingConfig) -> tuple[MixedPool, MixedPool]:
    """Windows to train on and to validate on; without validation clips, the training clips are used.

    The readers must stay open as long as the pools are used. Raises: InputError if there are no training clips.
    """
    cache_mb = config.cache_mb / len(readers)
    training = MixedPool(
        [WindowPool(reader, ("train",), balance=config.balance, cache_mb=cache_mb) for reader in readers]
    )
    held_back = [pool for reader in readers if (pool := _held_back(reader)) is not None]
    return training, MixedPool(held_back) if held_back else training


def _held_back(reader: TpcReader) -> WindowPool | None:
    try:
        return WindowPool(reader, ("val",), cache_mb=0)
    except InputError:
        return None


def joined(windows: Sequence[Windows], order: np.ndarray) -> Windows:
    """Windows of several batches as one, in another order; rows of bones are padded to the largest number."""
    index = torch.from_numpy(order)
    bones = max(each.parents.shape[1] for each in windows)

    def padded(values: Tensor, dim: int, fill: float) -> Tensor:
        short = bones - values.shape[dim]
        return F.pad(values, (0, 0) * (values.dim() - 1 - dim) + (0, short), value=fill)

    def whole(name: str, dim: int, fill: float = 0) -> Tensor:
        return torch.cat([padded(getattr(each, name), dim, fill) for each in windows])[index]

    rotations = whole("rotations", 2)
    rotations[..., 3] = torch.where(rotations.square().sum(-1) < 0.5, 1.0, rotations[..., 3])  # unused rows: identity
    return Windows(
        whole("heads", 2),
        rotations,
        torch.cat([each.valid for each in windows])[index],
        whole("parents", 1, -1),
        whole("tails", 1),
        whole("groups", 1),
        whole("weights", 1),
    )
