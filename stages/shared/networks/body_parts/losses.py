"""The reconstruction loss of body parts (de Clermont Gallerande et al. 2025, eq. 1).

The paper leaves some of its terms open. Here all derivatives are differences between frames, not divided by the
frames' time; angles are in radians, positions in metres; every term is a mean over windows, frames and joints. A
part's rotations and positions are taken in its own tree: its first joint is at the origin and has the rotation that
the network sees, which for a limb is the connector's in the frame of the connector's parent.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.matrix_poses import (
    angles_of_matrices,
    global_matrices,
    matrices_of_columns,
    positions_of_matrices,
)

AVERAGED_FRAMES = 10  # over which changes of an angle are averaged
_LEAST = 1e-12


def reconstruction_terms(made: Tensor, truth: Tensor, offsets: Tensor, parents: np.ndarray) -> dict[str, Tensor]:
    """The terms of eq. 1, scalars, without their weights.

    Args:
        made, truth: (B, T, K, 6) columns; those made need be neither unit nor at right angles.
        offsets: (K, 3) metres. parents: (K,) within the part.

    mse:    of the columns.
    mpjae:  geodesic angle between global rotations. mpjlae: between rotations in the parents' frames.
    av:     change of the global angle from one frame to the next, averaged over ten frames, its magnitude.
    aa:     change of that average from one frame to the next, its magnitude.
    mpjpe:  distance of positions. jerk: distance of their third differences.
    A term that needs more frames than the window has is 0.
    """
    local, true_local = matrices_of_columns(made), matrices_of_columns(truth)
    whole, true_whole = (global_matrices(each, parents) for each in (local, true_local))
    angles = angles_of_matrices(whole, true_whole)
    apart = positions_of_matrices(whole, offsets, parents) - positions_of_matrices(true_whole, offsets, parents)
    # The mean of ten successive changes is a tenth of the whole change.
    velocities = (angles[:, AVERAGED_FRAMES:] - angles[:, :-AVERAGED_FRAMES]) / AVERAGED_FRAMES
    return {
        "mse": (made - truth).square().mean(),
        "mpjae": angles.mean(),
        "mpjlae": angles_of_matrices(local, true_local).mean(),
        "av": _mean(velocities.abs()),
        "aa": _mean(velocities.diff(dim=1).abs()),
        "mpjpe": _lengths(apart).mean(),
        "jerk": _mean(_lengths(apart.diff(n=3, dim=1))),
    }


def weighted_sum(terms: Mapping[str, Tensor], weights: Mapping[str, float]) -> Tensor:
    """Eq. 1: the sum of the terms, each by its weight."""
    return torch.stack([weights[name] * term for name, term in terms.items()]).sum()


def _lengths(vectors: Tensor) -> Tensor:
    return (vectors.square().sum(-1) + _LEAST).sqrt()


def _mean(values: Tensor) -> Tensor:
    return values.mean() if values.numel() else values.sum()
