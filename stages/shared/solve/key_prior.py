"""A prior from the keys: how far, and about which axes, each joint of a rig rotates.

A hinge that bends about one axis in every key does not twist between them, and a twist joint that never moved does
not move. The spread of a joint's rotations over the keys shows both, and becomes the solve's prior.
"""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.kinematics.rotations import aligned_signs, turns_between

OPEN_KEYS = 1.0  # weight of the uninformed prior, in keys, beside the first key


def turn_prior(local: Tensor, open_rad: float, widening: float = 4.0) -> Tensor:
    """Precision (J, 3, 3) of the corrections of the joints, in their own axes, 1 / radians^2.

    The expected covariance of a correction is the mean of the joint's covariance over the keys, `widening` times,
    and of `open_rad`^2 in all axes, the latter with the weight of `OPEN_KEYS` keys; never wider than the latter.

    Args:
        local: (K, J, 4) rotations at the keys in the parents' frames. One key gives no information.
        open_rad: expected size of a correction without information.
    """
    keys = len(local)
    open_cov = open_rad**2 * torch.eye(3, device=local.device)
    local = aligned_signs(local, local[:1])
    mean = torch.nn.functional.normalize(local.mean(0), dim=-1)
    away = turns_between(mean.expand_as(local), local)
    spread = torch.einsum("kji,kjl->jil", away, away) / max(keys - 1, 1)
    expected = ((keys - 1) * widening * spread + OPEN_KEYS * open_cov) / (keys - 1 + OPEN_KEYS)
    values, axes = torch.linalg.eigh(expected)
    values = values.clamp(max=open_rad**2)
    return (axes / values.unsqueeze(-2)) @ axes.transpose(-1, -2)
