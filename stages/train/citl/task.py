"""Training the interpolator in pose space (PC-MRL 3.4): batches, rest-pose augmentation, loss, validation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.rest_pose import moved_rest_pose, realign
from stages.shared.kinematics.rotations import aligned_signs, conjugate, rotate
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pcmrl.pose_interpolator import PoseInterpolator, PoseWindows
from stages.shared.training.masks import draw_keys
from stages.shared.training.task import HELD_BACK_SEED, RowRandom, TrainingTask, step_seed
from stages.shared.training.windows import WindowPool, Windows
from stages.train.citl.config import Config

_VALIDATION_WINDOWS = 32
_LEAST = 1e-6  # under the root: keeps the slope finite if prediction equals truth


@dataclass
class PoseBatch:
    """Windows, the plain interpolation of their known frames, known and valid (B, T)."""

    truth: PoseWindows
    base: PoseWindows
    known: Tensor
    valid: Tensor

    def to(self, device: torch.device) -> PoseBatch:
        return PoseBatch(
            _moved(self.truth, device), _moved(self.base, device), self.known.to(device), self.valid.to(device)
        )


def pose_batch(windows: Windows, known: Tensor) -> PoseBatch:
    """Windows with the plain interpolation of their known frames (B, T)."""
    base = interpolate_windows(windows.heads, windows.rotations, windows.parents, known, rate_hz=MODEL_FPS)
    truth = PoseWindows(windows.heads, windows.rotations, windows.tails)
    return PoseBatch(truth, PoseWindows(*base, windows.tails), known, windows.valid)


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
        self.held_back = list(self._validation(held_back))

    def drawer(self, *, elsewhere: bool = False) -> PoseDrawer:
        return self._drawer

    def splits(self) -> bool:
        return True

    def weight(self, batch: PoseBatch, rows: int) -> float:
        """The loss is a mean over missing frames."""
        return float((batch.valid & ~batch.known).sum())

    def _validation(self, pool: WindowPool):
        """The same held-back windows with keys every 5, 15 and 30 frames."""
        config = self.config
        windows = pool.draw(_VALIDATION_WINDOWS, config.window, step_seed(HELD_BACK_SEED, 5, 0), augment=False)
        frames = torch.arange(config.window)
        last = windows.valid.sum(1, keepdim=True) - 1
        for every in (5, 15, 30):
            yield str(every), pose_batch(windows, ((frames % every == 0) | (frames == last)) & windows.valid)

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
            made, base = errors_of(self._made(batch), batch), errors_of(batch.base, batch)
            shares |= {f"{name}_of_base_{every}": float(made[name] / base[name].clamp_min(1e-9)) for name in made}
        return {"score": float(np.mean(list(shares.values()))), **shares}


def errors_of(found: PoseWindows, batch: PoseBatch) -> dict[str, Tensor]:
    """Mean over missing frames of the 2-norms of the errors of positions (metres) and of rotations, scalars."""
    missing = batch.valid & ~batch.known
    true = batch.truth.rotations
    squares = {
        "l2p": (found.heads - batch.truth.heads).square().sum((-2, -1)),
        "l2q": (aligned_signs(found.rotations, true) - true).square().sum((-2, -1)),
    }
    roots = {name: (square + _LEAST).sqrt() - _LEAST**0.5 for name, square in squares.items()}
    return {name: (root * missing).sum() / missing.sum().clamp_min(1) for name, root in roots.items()}


def one_hierarchy(pool: WindowPool) -> tuple[np.ndarray, np.ndarray]:
    """Parents and body groups (J,) of the pool's skeletons, which must agree. Raises InputError otherwise."""
    parents, groups = pool.parents.numpy(), pool.groups.numpy()
    if (parents != parents[0]).any() or (groups != groups[0]).any():
        raise InputError(
            f"The tpc artefact holds {len(parents)} skeletons of different hierarchies; pose space is of one.",
            "Adapt all motions to one skeleton first: pumps train skeleton, pumps decode --method network.",
        )
    return parents[0], groups[0]


def _moved(windows: PoseWindows, device: torch.device) -> PoseWindows:
    return PoseWindows(windows.heads.to(device), windows.rotations.to(device), windows.tails.to(device))
