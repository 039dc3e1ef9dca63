"""Poses as rotation matrices, for losses that are differentiated: columns, forward kinematics, angles.

Plain functions on torch tensors with any leading dimensions. `forward.py` does the same with quaternions; matrices
need fewer operations a joint, which halves a training step on a CPU.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.rotations import from_matrices, matrices

_LEAST = 1e-12  # under the root of a squared length, so that the slope at 0 is finite
_MOST_SINE = 1.0 - 1e-6  # the arc sine's slope at 1 is infinite


def matrices_of_columns(columns: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of their first two columns (..., 6), which need be neither unit nor at right
    angles (Zhou et al. 2019): Gram and Schmidt's method, then the cross product."""
    first, second = columns.unflatten(-1, (2, 3)).unbind(-2)
    first = torch.nn.functional.normalize(first, dim=-1)
    second = second - (first * second).sum(-1, keepdim=True) * first
    second = torch.nn.functional.normalize(second, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second, dim=-1)], dim=-1)


def columns_of_matrices(matrices: Tensor) -> Tensor:
    """The first two columns (..., 6) of matrices (..., 3, 3), the inverse of `matrices_of_columns`."""
    return matrices[..., :2].transpose(-1, -2).flatten(-2)


def columns_of(rotations: Tensor) -> Tensor:
    """The first two columns (..., 6) of the matrices of unit quaternions (..., 4), a continuous form (Zhou 2019)."""
    return columns_of_matrices(matrices(rotations))


def rotations_of_columns(columns: Tensor) -> Tensor:
    """Unit quaternions (..., 4) of two columns (..., 6) that need be neither of length 1 nor at right angles."""
    return from_matrices(matrices_of_columns(columns.float()))


def global_matrices(local: Tensor, parents: np.ndarray) -> Tensor:
    """Rotations in the parents' frames (..., J, 3, 3) to those in joint 0's parent's frame, (..., J, 3, 3)."""
    levels, order = _levels(tuple(int(parent) for parent in parents))
    made = [local[..., :1, :, :]]
    for joints, above in levels:
        made.append(made[-1][..., above, :, :] @ local[..., joints, :, :])
    return torch.cat(made, dim=-3)[..., order, :, :]


def positions_of_matrices(rotations: Tensor, offsets: Tensor, parents: np.ndarray) -> Tensor:
    """Heads (..., J, 3) of all joints, joint 0 at the origin, from global rotations (..., J, 3, 3).

    offsets: (J, 3) heads in the parents' frames; the unit of the result is theirs.
    """
    above = [int(parent) for parent in parents[1:]]
    steps = (rotations[..., above, :, :] @ offsets[1:].unsqueeze(-1)).squeeze(-1)
    # Each joint's position is the sum of the steps on its way from joint 0.
    return torch.einsum("js,...sc->...jc", _ways(tuple(above), steps.dtype, steps.device), steps)


def angles_of_matrices(first: Tensor, second: Tensor) -> Tensor:
    """Geodesic angles (...) in radians between rotation matrices (..., 3, 3).

    Matrices that differ by an angle a lie 2 sqrt(2) sin(a / 2) apart (Frobenius). This equals the arc cosine of the
    trace, and its slope is finite where the two are equal.
    """
    apart = ((first - second).square().sum((-1, -2)) + _LEAST).sqrt()
    return 2 * torch.asin((apart / (2 * math.sqrt(2))).clamp(max=_MOST_SINE))


@lru_cache(maxsize=64)
def _levels(parents: tuple[int, ...]) -> tuple[list[tuple[list[int], list[int]]], list[int]]:
    """For each depth below joint 0 its joints, and their parents' places in the depth above. Then the place of each
    joint in all depths joined."""
    depth = [0]
    for parent in parents[1:]:
        depth.append(depth[parent] + 1)
    by_depth = [[joint for joint, d in enumerate(depth) if d == level] for level in range(max(depth) + 1)]
    above = [[upper.index(parents[joint]) for joint in level] for upper, level in pairwise(by_depth)]
    joined = [joint for level in by_depth for joint in level]
    return list(zip(by_depth[1:], above, strict=True)), [joined.index(joint) for joint in range(len(parents))]


@lru_cache(maxsize=64)
def _ways(above: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    """(J, J - 1): 1 where the step to joint s + 1 lies on the way to joint j."""
    rows: list[Sequence[float]] = [[0.0] * len(above)]
    for step, parent in enumerate(above):
        row = list(rows[parent])
        row[step] = 1.0
        rows.append(row)
    return torch.tensor(rows, dtype=dtype, device=device)
