"""Windows of one skeleton's poses for training: the truth, the plain interpolation, errors of filled frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.rotations import aligned_signs
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.networks.pcmrl.pose_interpolator import PoseWindows
from stages.shared.training.task import HELD_BACK_SEED, step_seed
from stages.shared.training.windows import WindowPool, Windows

VALIDATION_WINDOWS = 32
VALIDATION_INTERVALS = (5, 15, 30)
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


def validation_batches(pool: WindowPool, window: int) -> list[tuple[str, PoseBatch]]:
    """The same held-back windows with keys every 5, 15 and 30 frames, each with its interval as text."""
    windows = pool.draw(VALIDATION_WINDOWS, window, step_seed(HELD_BACK_SEED, 5, 0), augment=False)
    frames = torch.arange(window)
    last = windows.valid.sum(1, keepdim=True) - 1
    return [
        (str(every), pose_batch(windows, ((frames % every == 0) | (frames == last)) & windows.valid))
        for every in VALIDATION_INTERVALS
    ]


def shares_of_base(found: PoseWindows, batch: PoseBatch, every: str) -> dict[str, float]:
    """L2P and L2Q of filled windows as shares of the plain interpolation's: `l2p_of_base_15` and so on."""
    made, base = errors_of(found, batch), errors_of(batch.base, batch)
    return {f"{name}_of_base_{every}": float(made[name] / base[name].clamp_min(1e-9)) for name in made}


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
