"""A start for the solve if its base is far from the cloud: bones fitted rigidly to their own points."""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.solve.solve_equations import Base, Chain, Pose, forward

START_BELIEF = 0.01  # square metres: four points at 5 cm have the weight of the parent's rotation


def rigid_start(targets: Tensor, chain: Chain, base: Base) -> Pose:
    """Each bone turned by the rigid fit of its own points (Kabsch), as far as they determine it; otherwise with its
    parent.

    The body as a whole is fitted first, then bone after bone down the chain, each with a prior, worth a few points,
    of moving with its parent.
    """
    start = Pose(base.local, base.root)
    rotations, heads = forward(start, chain, base)
    points = heads[:, chain.bones] + (rotations[:, chain.bones] @ chain.in_bone.unsqueeze(-1)).squeeze(-1)
    weights = chain.weights.unsqueeze(-1)
    total = weights.sum().clamp(min=1e-12)
    middle, wanted = ((weights * cloud).sum(1, keepdim=True) / total for cloud in (points, targets))
    whole = (weights * (targets - wanted)).transpose(-1, -2) @ (points - middle)
    turn = _nearest_rotation(whole)

    # Of each bone: sum of w (target - mean) (in_bone - mean)'.
    mass = (chain.riding @ chain.weights).clamp(min=1e-12)
    mean = (chain.riding @ (weights * chain.in_bone)) / mass.unsqueeze(-1)
    arms = weights * (chain.in_bone - mean[chain.bones])
    spread = chain.riding @ (targets.unsqueeze(-1) * arms.unsqueeze(-2)).flatten(-2)
    spread = spread.unflatten(-1, (3, 3))
    belief = START_BELIEF * chain.weights.amax()
    local = base.local.clone()
    world = torch.empty_like(rotations)
    world[:, 0] = _nearest_rotation(spread[:, 0] + belief * (turn @ base.local[:, 0]))
    local[:, 0] = world[:, 0]
    for children, parents in chain.levels:
        along = world[:, parents] @ base.local[:, children]
        world[:, children] = _nearest_rotation(spread[:, children] + belief * along)
        local[:, children] = world[:, parents].transpose(-1, -2) @ world[:, children]
    _, heads = forward(Pose(local, base.root), chain, base)
    placed = heads[:, chain.bones] + (world[:, chain.bones] @ chain.in_bone.unsqueeze(-1)).squeeze(-1)
    return Pose(local, base.root + (weights * (targets - placed)).sum(1) / total)


def _nearest_rotation(matrix: Tensor) -> Tensor:
    """The rotation (..., 3, 3) nearest to a matrix: of all, the one with the largest inner product (Umeyama 1991)."""
    left, sizes, right = torch.linalg.svd(matrix)
    signs = torch.ones_like(sizes)
    signs[..., -1] = torch.linalg.det(left @ right).sign()  # the least of three axes turns back a reflection
    return (left * signs.unsqueeze(-2)) @ right
