"""The solve's normal equations for every joint's turn, from the points and the prior, by moments of subtrees.

Every point is bound to a bone. A point moves by `omega x (p - head)` when a joint above it turns by `omega`, so that
the equations need only the points' weights, first and second moments summed over each joint's subtree: the cost of a
frame grows with the points plus the square of the joints, not with their product.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.forward import global_rotations, joint_positions
from stages.shared.kinematics.rotations import from_matrices, from_turn_vectors, matrices, turn_vectors
from stages.shared.solve.binding import Binding

REFERENCE_POINTS = 256  # the weight of a cloud is that of this many points, whatever its number of points
MOMENTS = (1, 3, 9, 3, 3)  # widths of a bone's sums of w, w p, w p p', w e and w p x e


@dataclass(frozen=True)
class SolveOptions:
    """Weights of the points against the base pose.

    point_noise_m:  expected distance of a point from its position on its bone, metres.
    huber_m:        residuals beyond this pull with a constant force, metres.
    turn_prior_rad: expected size of a joint's correction, radians.
    shift_prior_m:  expected size of the pelvis' correction, metres.
    iterations:     the most Gauss-Newton steps of a frame.
    slack_m:        common offset that the points of a bone may have, metres: 0 if the cloud is of this body, about a
                    tenth of a metre if it is of another.
    rigid_start:    also try each bone's rigid fit to its points as a start, and use the better start in each frame;
                    for bases that may be far from the cloud, such as a single held key.
    """

    point_noise_m: float = 0.06
    huber_m: float = 0.05
    turn_prior_rad: float = 0.5
    shift_prior_m: float = 0.3
    iterations: int = 8
    slack_m: float = 0.0
    rigid_start: bool = False


class Chain(NamedTuple):
    """The A joints to solve, the pelvis first, and their hierarchy."""

    joints: Tensor  # (A,) index into the skeleton
    levels: list[tuple[Tensor, Tensor]]  # children and their parents, index into the chain, one level at a time
    riding: Tensor  # (A, P) float32, 1 if the point is bound to the joint's own bone
    below: Tensor  # (A, A) float32, 1 where the second joint is the first or one of its descendants
    upper: Tensor  # (N,) pairs of a joint ...
    lower: Tensor  # (N,) ... and itself or a descendant
    bones: Tensor  # (P,) each point's bone, index into the chain
    in_bone: Tensor  # (P, 3)
    carried: Tensor  # (4A, P): for each bone the places in it of its own points, and 1; 0 for other points
    products: Tensor  # (P, 13A): for each bone 1, b and b b' of its own points' places b in it; 0 for other points
    weights: Tensor  # (P,) in units of 1 / metres^2; the sum over all points is that of REFERENCE_POINTS
    prior: Tensor  # (A, 3, 3) precision of each joint's turn in its own axes, 1 / radians^2
    prior_matrix: Tensor  # (3 + 3A, 3 + 3A) the prior's part of the normal matrix


class Base(NamedTuple):
    """The base pose of the chain: (T, A, 3, 3) local rotations (the pelvis' is global), (T, 3) pelvis, (T, A, 3)."""

    local: Tensor
    root: Tensor
    offsets: Tensor


class Pose(NamedTuple):
    local: Tensor  # (T, A, 3, 3)
    root: Tensor  # (T, 3)


class System(NamedTuple):
    """Normal equations of a frame: unknowns are the pelvis' shift and A turns, all in world axes."""

    matrix: Tensor  # (T, 3 + 3A, 3 + 3A)
    pull: Tensor  # (T, 3 + 3A)
    cost: Tensor  # (T,)
    residual: Tensor  # (T,)


def build_chain(
    binding: Binding, parents: np.ndarray, root: int, options: SolveOptions, turn_prior: Tensor | None = None
) -> Chain:
    device = binding.in_bone.device
    paths: dict[int, list[int]] = {}
    for bone in {int(joint) for joint in binding.joints.tolist()} | {root}:
        path = [bone]
        while path[-1] != root and path[-1] >= 0:
            path.append(int(parents[path[-1]]))
        if path[-1] == root:
            paths[bone] = path
    joints = sorted({joint for path in paths.values() for joint in path}, key=lambda joint: (joint != root, joint))
    place = {joint: index for index, joint in enumerate(joints)}
    above = {joint: [joint] for joint in joints[:1]}  # every joint's ancestors and itself
    for joint in joints[1:]:
        above[joint] = [*above[int(parents[joint])], joint]
    levels: dict[int, list[int]] = {}
    for joint in joints[1:]:
        levels.setdefault(len(above[joint]), []).append(joint)
    bones = torch.tensor([place.get(int(joint), 0) for joint in binding.joints.tolist()], device=device)
    tied = torch.tensor([int(joint) in paths for joint in binding.joints.tolist()], device=device)
    rows = torch.arange(len(joints), device=device).unsqueeze(-1)
    riding = (tied & (bones == rows)).float()
    below = torch.zeros(len(joints), len(joints))
    for joint in joints:
        below[torch.tensor([place[one] for one in above[joint]]), place[joint]] = 1.0
    if turn_prior is None:
        prior = torch.eye(3, device=device).expand(len(joints), 3, 3) * options.turn_prior_rad**-2
    else:
        prior = turn_prior.to(device)[torch.tensor(joints, device=device)]
    pairs = [(place[one], place[joint]) for joint in joints for one in above[joint]]
    scale = REFERENCE_POINTS / max(len(bones), 1) / options.point_noise_m**2

    def indices(values: list[int]) -> Tensor:
        return torch.tensor(values, dtype=torch.long, device=device)

    return Chain(
        joints=indices(joints),
        levels=[
            (indices([place[j] for j in level]), indices([place[int(parents[j])] for j in level]))
            for _, level in sorted(levels.items())
        ],
        riding=riding,
        below=below.to(device),
        upper=indices([pair[0] for pair in pairs]),
        lower=indices([pair[1] for pair in pairs]),
        bones=bones,
        in_bone=binding.in_bone,
        carried=(riding.unsqueeze(1) * _with_one(binding.in_bone).t()).flatten(0, 1),
        products=(riding.t().unsqueeze(-1) * _products(binding.in_bone).unsqueeze(1)).flatten(1),
        weights=binding.weights * tied * scale,
        prior=prior,
        prior_matrix=_prior_matrix(prior, options),
    )


def _with_one(places: Tensor) -> Tensor:
    """(P, 3) -> (P, 4), with a last column of ones."""
    return torch.cat([places, torch.ones_like(places[:, :1])], dim=-1)


def _products(places: Tensor) -> Tensor:
    """1, b and b b' of places b, (P, 3) -> (P, 13)."""
    outer = (places.unsqueeze(-1) * places.unsqueeze(-2)).flatten(1)
    return torch.cat([torch.ones_like(places[:, :1]), places, outer], dim=-1)


def base_of(chain: Chain, local: Tensor, roots: Tensor, offsets: Tensor, parents: np.ndarray, root: int) -> Base:
    frames = local.shape[0]
    # Joints above the pelvis never move in the solve: fold them into the pelvis' own transform.
    lead = root + 1  # parents come before children, so the pelvis' ancestors are among these
    rotations = global_rotations(local[:, :lead], parents[:lead])
    heads = joint_positions(rotations, roots, offsets[..., :lead, :], parents[:lead])
    chain_local = local[:, chain.joints].clone()
    chain_local[:, 0] = rotations[:, root]
    chain_offsets = offsets.expand(frames, -1, 3)[:, chain.joints]
    return Base(matrices(chain_local), heads[:, root], chain_offsets)


def forward(pose: Pose, chain: Chain, base: Base) -> tuple[Tensor, Tensor]:
    """Global rotations (T, A, 3, 3) and heads (T, A, 3) of the chain."""
    rotations, heads = pose.local.clone(), torch.empty_like(base.offsets)
    heads[:, 0] = pose.root
    for children, parents in chain.levels:
        above = rotations[:, parents]
        heads[:, children] = heads[:, parents] + (above @ base.offsets[:, children].unsqueeze(-1)).squeeze(-1)
        rotations[:, children] = above @ pose.local[:, children]
    return rotations, heads


def move(pose: Pose, step: Tensor, chain: Chain) -> Pose:
    """Apply a step (T, 3 + 3A): the shift in world axes, the turns in the joints' own axes."""
    turns = matrices(from_turn_vectors(step[:, 3:].reshape(len(step), -1, 3)))
    return Pose(pose.local @ turns, pose.root + step[:, :3])


def _cross_matrix(v: Tensor) -> Tensor:
    """(..., 3) to the matrix (..., 3, 3) that takes u to v x u."""
    x, y, z = v.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))


def misfit(targets: Tensor, pose: Pose, chain: Chain, base: Base, options: SolveOptions) -> Tensor:
    """(T,) the points' part of the cost of a pose, without slack."""
    rotations, heads = forward(pose, chain, base)
    arms = (rotations[:, chain.bones] @ chain.in_bone.unsqueeze(-1)).squeeze(-1)
    return _robust((targets - heads[:, chain.bones] - arms).norm(dim=-1), chain, options)


def _robust(distance: Tensor, chain: Chain, options: SolveOptions) -> Tensor:
    """(T,) Huber's cost of the points' distances (T, P) from their targets."""
    inside = distance.clamp(max=options.huber_m)
    return (chain.weights * inside * (distance - inside / 2)).sum(-1)


def linearise(targets: Tensor, pose: Pose, chain: Chain, base: Base, options: SolveOptions) -> System:
    """The equations of all frames about a pose; `targets` (T, P, 3), metres."""
    rotations, heads = forward(pose, chain, base)
    # Relative to the pelvis, so that float32 is precise enough if the motion is far from the origin.
    centre = pose.root.unsqueeze(1)
    heads = heads - centre
    # Coordinates come before points: everything over the points is then a product with a matrix that never changes,
    # or runs over contiguous memory.
    carriers = torch.cat([rotations, heads.unsqueeze(-1)], dim=-1).transpose(1, 2).flatten(2)  # (T, 3, 4A)
    misses = (targets - centre).transpose(1, 2).contiguous() - carriers @ chain.carried
    distance = misses.square().sum(1).sqrt()
    weights = chain.weights * (options.huber_m / distance.clamp(min=options.huber_m))
    of_bones = _moments(weights, misses, heads, rotations, chain)
    given = 0.0
    if options.slack_m > 0:
        of_bones, given = _without_common_shift(of_bones, options.slack_m**-2)
    mass, first, second, force, torque = (chain.below @ of_bones).split(MOMENTS, dim=-1)
    matrix = _evidence(mass, first, second.unflatten(-1, (3, 3)), heads, rotations, chain)
    torque = torque - torch.linalg.cross(heads, force)
    torque = (rotations.transpose(-1, -2) @ torque.unsqueeze(-1)).squeeze(-1)
    pull = torch.cat([force[:, 0], torque.flatten(1)], dim=-1)

    turned = turn_vectors(from_matrices(base.local.transpose(-1, -2) @ pose.local))
    shifted = pose.root - base.root
    held = (chain.prior @ turned.unsqueeze(-1)).squeeze(-1)
    back = torch.cat([shifted * options.shift_prior_m**-2, held.flatten(1)], dim=-1)
    from_base = torch.cat([shifted, turned.flatten(1)], dim=-1)
    matrix += chain.prior_matrix
    pull = pull - back

    cost = _robust(distance, chain, options) - given + (back * from_base).sum(-1) / 2
    total = weights.sum(-1).clamp(min=1e-12)
    residual = ((weights * distance**2).sum(-1) / total).sqrt()
    return System(matrix, pull, cost, residual)


def _moments(weights: Tensor, misses: Tensor, heads: Tensor, rotations: Tensor, chain: Chain) -> Tensor:
    """Each bone's sums over its points of w, w p, w p p', w e and w p x e, (T, A, 19).

    A point's place p = h + R b follows from its bone's head h and rotation R and from its place b in the bone. So the
    sums are taken of w, w b, w b b', w e and w e b', by two products, and then turned and moved, once for a bone.

    Args:
        weights: (T, P) w. misses: (T, 3, P) e. heads: (T, A, 3) h. rotations: (T, A, 3, 3) R.
    """
    mass, first, second = (weights @ chain.products).unflatten(-1, (-1, 13)).split(MOMENTS[:3], dim=-1)
    turned = (rotations @ first.unsqueeze(-1)).squeeze(-1)
    mixed = turned.unsqueeze(-1) * heads.unsqueeze(-2)
    second = rotations @ second.unflatten(-1, (3, 3)) @ rotations.transpose(-1, -2)
    second = second + mixed + mixed.transpose(-1, -2)
    moved = mass * heads
    second = second + moved.unsqueeze(-1) * heads.unsqueeze(-2)
    pulls = ((weights.unsqueeze(1) * misses) @ chain.carried.t()).unflatten(-1, (-1, 4)).transpose(1, 2)
    force = pulls[..., 3]
    around = rotations @ pulls[..., :3].transpose(-1, -2)  # sum of w (R b) e'
    torque = around[..., (1, 2, 0), (2, 0, 1)] - around[..., (2, 0, 1), (1, 2, 0)]
    torque = torque + torch.linalg.cross(heads, force)
    return torch.cat([mass, turned + moved, second.flatten(-2), force, torque], dim=-1)


def _prior_matrix(prior: Tensor, options: SolveOptions) -> Tensor:
    shift = torch.eye(3, device=prior.device) * options.shift_prior_m**-2
    return torch.block_diag(shift, *prior.unbind(0))


def _without_common_shift(moments: Tensor, looseness: float) -> tuple[Tensor, Tensor]:
    """Bones' moments (T, A, 19) after elimination of a shift of each bone's points, of precision `looseness`, and the
    cost (T,) that this saves. Eliminating a shift leaves weights diag(w) - w w' / (sum w + looseness).
    """
    mass, first, second, force, torque = moments.split(MOMENTS, dim=-1)
    share = 1 / (mass + looseness)
    kept = looseness * share
    outer = (first.unsqueeze(-1) * first.unsqueeze(-2)).flatten(-2)
    parts = [
        mass * kept,
        first * kept,
        second - share * outer,
        force * kept,
        torque - share * torch.linalg.cross(first, force),
    ]
    return torch.cat(parts, dim=-1), (share.squeeze(-1) * force.square().sum(-1)).sum(-1) / 2


def _evidence(mass: Tensor, first: Tensor, second: Tensor, heads: Tensor, rotations: Tensor, chain: Chain) -> Tensor:
    """The points' part of the normal matrix, (T, 3 + 3A, 3 + 3A), from subtree moments (T, A, ...).

    For a joint i and its descendant j only the points below j contribute: the block is the sum of `(a . b) I - b a'`
    with a = p - head_i and b = p - head_j, turned into both joints' own axes.
    """
    frames, joints = mass.shape[:2]
    upper, lower = chain.upper, chain.lower
    m, s, q = mass[:, lower], first[:, lower], second[:, lower]
    over, under = heads[:, upper], heads[:, lower]
    outer = (
        q
        - s.unsqueeze(-1) * over.unsqueeze(-2)
        - under.unsqueeze(-1) * s.unsqueeze(-2)
        + (m * under).unsqueeze(-1) * over.unsqueeze(-2)
    )  # sum of b a'
    trace = torch.diagonal(outer, dim1=-2, dim2=-1).sum(-1)
    block = trace[..., None, None] * torch.eye(3, device=mass.device, dtype=mass.dtype) - outer
    # d point / d turn_i is -[a]x, so the block is [a]x' [b]x = (a.b) I - b a'; rows belong to i, columns to j.
    block = rotations[:, upper].transpose(-1, -2) @ block @ rotations[:, lower]
    # In memory the blocks have the order of the matrix, so that the reshape at the end makes no copy.
    full = mass.new_zeros(frames, joints + 1, 3, joints + 1, 3).transpose(2, 3)
    full[:, upper + 1, lower + 1] = block
    full[:, lower + 1, upper + 1] = block.transpose(-1, -2)
    # The shift moves every point by the same vector: against turn_i it gives -sum [a]x.
    against = -_cross_matrix(first - mass * heads) @ rotations
    full[:, 0, 1:] = against
    full[:, 1:, 0] = against.transpose(-1, -2)
    full[:, 0, 0] = mass[:, 0, :, None] * torch.eye(3, device=mass.device, dtype=mass.dtype)
    return full.transpose(2, 3).reshape(frames, 3 * joints + 3, 3 * joints + 3)
