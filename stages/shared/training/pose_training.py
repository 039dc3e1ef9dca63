"""Training a network on a task in one rig's pose space: windows of the rig's motion, the task's batches and loss."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.tpc import TpcReader
from stages.shared.networks.layers.device import precision
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.pose_network import PoseNetwork
from stages.shared.pose_tasks.task import PoseTask, TaskBatch
from stages.shared.training.config import TrainingConfig
from stages.shared.training.task import HELD_BACK_SEED, RowRandom, TrainingTask, step_random
from stages.shared.training.windows import WindowPool

_VALIDATION_WINDOWS = 32
_SCALING_WINDOWS = 32  # that scale the features
_VALIDATION, _SCALING = 11, 12  # the purposes of the generators
_SAME_M = 1e-4


def rig_pools(reader: TpcReader, rig: Rig, config: TrainingConfig) -> tuple[WindowPool, WindowPool]:
    """Windows of the rig's own motions, to train on and to validate on (the same where none are for validation).

    Raises: InputError if the artefact holds no clip of the rig.
    """
    own = sets_of_rig(reader, rig)
    if not own:
        raise InputError(
            f"{reader.artefact.path} holds no motion of the rig {rig.skeleton.names[rig.skeleton.root]} with "
            f"{len(rig.body.joints)} bones.",
            "Put motions on it first with `pumps data rerig`, then run `pumps sample-tpc` on them.",
        )
    training = WindowPool(reader, ("train",), balance=config.balance, cache_mb=config.cache_mb, skeletons=own)
    try:
        return training, WindowPool(reader, ("val",), balance=config.balance, cache_mb=0, skeletons=own)
    except InputError:
        return training, training


def sets_of_rig(reader: TpcReader, rig: Rig) -> frozenset[str]:
    """Ids of the artefact's sets of bones that are the rig's: the same tree and lengths, to 0.1 mm."""
    body = rig.body
    found = set()
    for name in sorted({row.skeleton for row in reader.clips if row.skeleton}):
        bones = reader.bones(name)
        if len(bones.parents) != len(body.joints) or (np.asarray(bones.parents) != body.parents).any():
            continue
        if np.abs(np.asarray(bones.tails) - body.tails.numpy()).max() < _SAME_M:
            found.add(name)
    return frozenset(found)


class TaskDrawer:
    """Draws windows of the rig's motion and what the task makes of them."""

    def __init__(self, config: TrainingConfig, task: PoseTask, pool: WindowPool):
        self.config, self.task, self.pool = config, task, pool

    def draw(self, rng: RowRandom) -> TaskBatch:
        return self.batch(rng, augment=self.config.augment)

    def batch(self, rng: RowRandom, *, augment: bool) -> TaskBatch:
        """A batch of `len(rng.rows)` windows."""
        windows = self.pool.draw(len(rng.rows), self.config.window, rng, augment=augment)
        clean = BodyPose(windows.heads[:, :, 0], windows.rotations)
        return self.task.draw(clean, windows.valid, rng.rows)


class PoseTraining(TrainingTask[PoseNetwork]):
    """Training one network on one task.

    The network is moved to the device. Its features are scaled by windows of the training pool.
    """

    def __init__(
        self,
        config: TrainingConfig,
        task: PoseTask,
        network: PoseNetwork,
        pool: WindowPool,
        held_back: WindowPool,
        device: torch.device,
        weights: dict[str, float],
    ):
        self.config, self.task, self.device, self.weights = config, task, device, weights
        self._drawer = TaskDrawer(config, task, pool)
        scaling = self._drawer.batch(_fixed(_SCALING, range(_SCALING_WINDOWS)), augment=config.augment)
        self.networks = network.to(device)
        network.normalise_by(scaling.features.to(device), scaling.given.to(device))
        rows = range(_VALIDATION_WINDOWS)
        self.held_back = TaskDrawer(config, task, held_back).batch(_fixed(_VALIDATION, rows), augment=False)

    def drawer(self, *, elsewhere: bool = False) -> TaskDrawer:
        return self._drawer

    def splits(self) -> bool:
        return True

    def weight(self, batch: TaskBatch, rows: int) -> float:
        """The loss is a mean over real frames."""
        return float(batch.valid.sum())

    def made(self, batch: TaskBatch) -> BodyPose:
        """The network's pose of a batch on the device."""
        times = torch.arange(float(batch.valid.shape[1]), device=self.device).unsqueeze(0)
        with precision(self.device, self.config.mixed_precision):
            return self.networks(batch.features, batch.given, batch.base, times, batch.valid)

    def loss(self, batch: TaskBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        batch = batch.to(self.device)
        errors = self.task.errors(self.made(batch), batch)
        value = torch.stack([self.weights.get(name, 1.0) * error for name, error in errors.items()]).sum()
        return value, {name: error.detach() for name, error in errors.items()}

    def validate(self) -> dict[str, float]:
        """The task's measures on fixed windows, for the network's pose and for the base pose alone."""
        batch = self.held_back.to(self.device)
        base = self.task.measures(batch.base, batch)
        return self.task.measures(self.made(batch), batch) | {f"{name}_of_base": base[name] for name in base}


def _fixed(purpose: int, rows: Sequence[int]) -> RowRandom:
    return step_random(HELD_BACK_SEED, purpose, 0, rows)
