"""Errors of bodies put together from parts, on a body of 1.80 m (de Clermont Gallerande et al. 2025, 4.1.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.matrix_poses import (
    angles_of_matrices,
    global_matrices,
    matrices_of_columns,
    positions_of_matrices,
)


@dataclass(frozen=True)
class JointErrors:
    """Errors (N, T, B) of each joint: distance_cm of global positions with the pelvis at the origin, global_deg and
    local_deg, geodesic angles of rotations in the world and in the parents' frames."""

    distance_cm: np.ndarray
    global_deg: np.ndarray
    local_deg: np.ndarray


def joint_errors(made: Tensor, truth: Tensor, offsets: np.ndarray, parents: np.ndarray) -> JointErrors:
    """The errors of columns (N, T, B, 6); offsets (B, 3) metres of the body of 1.80 m, parents (B,)."""
    with torch.inference_mode():
        local = [matrices_of_columns(each.double()) for each in (made, truth)]
        whole = [global_matrices(each, parents) for each in local]
        places = [positions_of_matrices(each, torch.from_numpy(offsets).double(), parents) for each in whole]
        return JointErrors(
            (100 * (places[0] - places[1]).norm(dim=-1)).numpy(),
            torch.rad2deg(angles_of_matrices(whole[0], whole[1])).numpy(),
            torch.rad2deg(angles_of_matrices(local[0], local[1])).numpy(),
        )


def grouped(errors: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    """(count,) mean of errors (N, T, B) over the joints of each body group."""
    return np.array([errors[..., groups == group].mean() for group in range(count)])
