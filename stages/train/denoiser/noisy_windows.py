"""Noise on windows of different rigs, and what mending leaves of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from stages.shared.humanoid.symmetric_pairs import pairs_of_limbs
from stages.shared.kinematics.forward import global_rotations, joint_positions, local_rotations
from stages.shared.kinematics.rotations import conjugate, rotate
from stages.shared.pose_tasks.noise import NOISES
from stages.shared.solve.robust_smoothing import mend_poses
from stages.shared.training.windows import Windows

NO_NOISE = "none"


def noisy_windows(
    windows: Windows, noises: Sequence[str], rows: Sequence[np.random.Generator], *, mended: bool
) -> tuple[Tensor, Tensor]:
    """Windows with noise, each by its own generator and on its own rig.

    Args:
        noises: names of `NOISES` or "none", one for each window. mended: mend the noisy windows (`mend_poses`).

    Returns: heads (B, T, J, 3) metres and global rotations (B, T, J, 4); frames and bones of padding stay.
    """
    heads, rotations = windows.heads.clone(), windows.rotations.clone()
    for row, (noise, rng) in enumerate(zip(noises, rows, strict=True)):
        frames = int(windows.valid[row].sum())
        bones = int((windows.parents[row] >= 0).sum()) + 1
        parents = windows.parents[row, :bones].numpy()
        groups = windows.groups[row, :bones].numpy()
        body = (heads[row, :frames, :bones], rotations[row, :frames, :bones])
        made = _noisy(*body, parents, groups, noise, rng, mended)
        heads[row, :frames, :bones], rotations[row, :frames, :bones] = made
    return heads, rotations


def _noisy(
    heads: Tensor,
    rotations: Tensor,
    parents: np.ndarray,
    groups: np.ndarray,
    noise: str,
    rng: np.random.Generator,
    mended: bool,
) -> tuple[Tensor, Tensor]:
    """One window: heads (T, J, 3) and rotations (T, J, 4) of all its bones, the pelvis first."""
    if noise == NO_NOISE and not mended:
        return heads, rotations
    above = torch.from_numpy(parents.clip(0))
    offsets = rotate(conjugate(rotations[:, above]), heads - heads[:, above])
    roots, local = heads[:, 0].numpy(), local_rotations(rotations, parents).numpy()
    # Windows have no names; pairs are found by the shape of the limbs.
    limbs = pairs_of_limbs(("",) * len(parents), parents, offsets.mean(0).numpy(), groups)
    if noise != NO_NOISE:
        roots, local, _ = NOISES[noise](roots, local, rng, limbs)
    if mended:
        found = mend_poses(local, roots, limbs=limbs)
        roots, local = found.positions, found.local
    turns = global_rotations(torch.from_numpy(np.asarray(local, np.float32)), parents)
    places = joint_positions(turns, torch.from_numpy(np.asarray(roots, np.float32)), offsets, parents)
    return places, turns
