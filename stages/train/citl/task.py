"""Training the interpolator in pose space (PC-MRL 3.4): batches, rest-pose augmentation, loss, validation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.rest_pose import moved_rest_pose, realign
from stages.shared.kinematics.rotations import conjugate, rotate
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pcmrl.pose_interpolator import PoseInterpolator, PoseWindows
from stages.shared.training.masks import draw_keys
from stages.shared.training.pose_windows import (
    PoseBatch,
    errors_of,
    one_hierarchy,
    pose_batch,
    shares_of_base,
    validation_batches,
)
from stages.shared.training.task import RowRandom, TrainingTask
from stages.shared.training.windows import WindowPool, Windows
from stages.train.citl.config import Config


class PoseDrawer:
    """Draws windows of poses and which of their frames are known. parents (J,) of all windows' bones."""

    def __init__(self, config: Config, pool: WindowPool, parents: np.ndarray):
        self.config, self.pool, self.parents = config, pool, parents

    def draw(self, rng: RowRandom) -> PoseBatch:
        config = self.config
        windows = self.pool.draw(len(rng.rows), config.window, rng, augment=config.augment)
        if config.rest_pose_m > 0:
            windows = self._on_other_rest_poses(windows, rng)
        known = torch.zeros_like(windows.valid)
        lengths = windows.valid.sum(1).tolist()
        for row, (length, own) in enumerate(zip(lengths, rng.rows, strict=True)):
            known[row, torch.from_numpy(draw_keys(length, own))] = True
        return pose_batch(windows, known)

    def _on_other_rest_poses(self, windows: Windows, rng: RowRandom) -> Windows:
        """Half of the windows get a random rest pose each (PC-MRL 3.4); the others are unchanged."""
        parents = self.parents
        above = torch.as_tensor(parents[1:], dtype=torch.long)
        heads, rotations = windows.heads[:, 0], windows.rotations[:, 0]
        steps = rotate(conjugate(rotations[:, above]), heads[:, 1:] - heads[:, above])
        offsets = torch.cat([torch.zeros_like(steps[:, :1]), steps], dim=1)
        chosen = torch.tensor([own.uniform() < 0.5 for own in rng.rows])
        moves = np.stack([own.standard_normal((2, len(parents), 3)) for own in rng.rows], axis=1)
        moves = self.config.rest_pose_m * torch.from_numpy(moves).float()
        new_offsets, tails = moved_rest_pose(offsets, windows.tails, parents, *moves)
        heads, rotations = realign(windows.heads, windows.rotations, windows.tails, new_offsets, tails, parents)
        gate = chosen.view(-1, 1, 1)
        return replace(
            windows,
            heads=torch.where(gate.unsqueeze(-1), heads, windows.heads),
            rotations=torch.where(gate.unsqueeze(-1), rotations, windows.rotations),
            tails=torch.where(gate, tails, windows.tails),
        )


class InterpolatorTask(TrainingTask[PoseInterpolator]):
    """Training the interpolator of one skeleton's poses."""

    def __init__(self, config: Config, pool: WindowPool, held_back: WindowPool, device: torch.device):
        self.config, self.device = config, device
        self.parents, self.groups = one_hierarchy(pool)
        self._drawer = PoseDrawer(config, pool, self.parents)
        one_hierarchy(held_back)
        torch.manual_seed(config.seed)
        self.networks = PoseInterpolator(self.parents.tolist(), self.groups.tolist(), config.network).to(device)
        self.held_back = validation_batches(held_back, config.window)

    def drawer(self, *, elsewhere: bool = False) -> PoseDrawer:
        return self._drawer

    def splits(self) -> bool:
        return True

    def weight(self, batch: PoseBatch, rows: int) -> float:
        """The loss is a mean over missing frames."""
        return float((batch.valid & ~batch.known).sum())

    def _made(self, batch: PoseBatch) -> PoseWindows:
        times = torch.arange(float(batch.known.shape[1]), device=self.device).unsqueeze(0)
        with precision(self.device, self.config.mixed_precision):
            heads, rotations = self.networks(batch.truth, batch.base, batch.known, times, batch.valid)
        return PoseWindows(heads, rotations, batch.truth.tails)

    def loss(self, batch: PoseBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """L2P and L2Q of the missing frames, as in evaluation. They are roots; with squares only long gaps would be
        learnt."""
        batch = batch.to(self.device)
        made = errors_of(self._made(batch), batch)
        with torch.no_grad():
            base = errors_of(batch.base, batch)
        value = made["l2p"] + self.config.rotation_weight * made["l2q"]
        return value, {f"{name}_of_base": float(made[name].detach() / base[name].clamp_min(1e-9)) for name in made}

    def validate(self) -> dict[str, float]:
        """L2P and L2Q as shares of the plain interpolation's, for keys every 5, 15 and 30 frames; `score` is the mean
        of all."""
        shares: dict[str, float] = {}
        for every, batch in self.held_back:
            batch = batch.to(self.device)
            shares |= shares_of_base(self._made(batch), batch, every)
        return {"score": float(np.mean(list(shares.values()))), **shares}
