"""From a moving cloud to a pose: damped Gauss-Newton on the joints' rotations, all frames at once (DESIGN 6.6).

Every point is bound to a bone (`stages.inference.binding`). The unknowns of a frame are a rotation vector for every
joint that a point sees, in the joint's own frame after its base rotation, and a shift of the pelvis. A point moves
by `omega x (p - head)` when a joint above it turns by `omega`, so that the normal equations need only the points'
weights, first and second moments summed over each joint's subtree: the cost of a frame grows with the points plus
the square of the joints, not with their product. A prior pulls every correction to zero: what no point sees stays at
the base pose, and what is seen badly moves little. Huber weights keep stray points from pulling a limb away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import roma
import torch
from torch import Tensor

from stages.inference.binding import Binding
from stages.kinematics.forward import global_rotations, joint_positions

REFERENCE_POINTS = 256  # the evidence of a cloud counts as if it had this many points, whatever it has
CHUNK_FRAMES = 512  # frames solved together; bounds the memory of a long clip
SETTLED = 1e-4  # radians and metres; a step below this in every frame ends the iteration


@dataclass(frozen=True)
class SolveOptions:
    """How far the points are believed against the base pose.

    point_noise_m:  expected distance of a point from where its bone carries it, metres.
    huber_m:        residuals beyond this pull with a constant force, metres.
    turn_prior_rad: expected size of a joint's correction, radians.
    shift_prior_m:  expected size of the pelvis' correction, metres.
    iterations:     the most Gauss-Newton steps of a frame.
    """

    point_noise_m: float = 0.06
    huber_m: float = 0.05
    turn_prior_rad: float = 0.5
    shift_prior_m: float = 0.3
    iterations: int = 8


class Corrections(NamedTuple):
    """What the solve adds to a base pose.

    turns:    (T, J, 3) rotation vectors, radians: local rotation = base * exp(turn). Zero where nothing is seen.
    shifts:   (T, 3) of the pelvis in the world, metres.
    seen:     (J,) bool, True for joints that some point's bone hangs on.
    residual: (T,) weighted root mean square distance that is left between points and targets, metres.
    """

    turns: Tensor
    shifts: Tensor
    seen: Tensor
    residual: Tensor


class _Chain(NamedTuple):
    """The joints to solve (A of them, the pelvis first) and how they hang together."""

    joints: Tensor  # (A,) index into the skeleton
    levels: list[tuple[Tensor, Tensor]]  # children and their parents, index into the chain, one level at a time
    below: Tensor  # (A, P) float32, 1 where the point rides on the joint or on one of its descendants
    upper: Tensor  # (N,) pairs of a joint ...
    lower: Tensor  # (N,) ... and itself or a descendant
    bones: Tensor  # (P,) each point's bone, index into the chain
    in_bone: Tensor  # (P, 3)
    weights: Tensor  # (P,) in units of 1 / metres^2, of all points together as many as REFERENCE_POINTS


class _Base(NamedTuple):
    """The base pose of the chain: (T, A, 3, 3) local rotations (the pelvis' is global), (T, 3) pelvis, (T, A, 3)."""

    local: Tensor
    root: Tensor
    offsets: Tensor


class _Pose(NamedTuple):
    local: Tensor  # (T, A, 3, 3)
    root: Tensor  # (T, 3)


class _System(NamedTuple):
    """Normal equations of a frame: unknowns are the pelvis' shift and A turns, all in world axes."""

    matrix: Tensor  # (T, 3 + 3A, 3 + 3A)
    pull: Tensor  # (T, 3 + 3A)
    cost: Tensor  # (T,)
    residual: Tensor  # (T,)


def solve_pose(
    targets: Tensor,
    binding: Binding,
    local: Tensor,
    roots: Tensor,
    offsets: Tensor,
    parents: np.ndarray,
    root: int = 0,
    options: SolveOptions | None = None,
) -> Corrections:
    """Corrections to a base pose that carry the bound points to their targets.

    Args:
        targets: (T, P, 3) where the points should be, metres.
        binding: the bone of every point and its place in the bone's frame.
        local: (T, J, 4) base rotations in the parents' frames, unit quaternions xyzw.
        roots: (T, 3) base positions of joint 0.
        offsets: (T, J, 3) or (J, 3) joints' heads in their parents' frames.
        parents: (J,), parents before children.
        root: the pelvis; joints above it stay as they are.
        options: strength of the prior and the like.

    Returns: Corrections, float32. Bones outside the pelvis' subtree are not solved.
    """
    options = options or SolveOptions()
    chain = _build_chain(binding, np.asarray(parents), root, options)
    frames, joints = local.shape[:2]
    turns = local.new_zeros(frames, joints, 3)
    shifts = local.new_zeros(frames, 3)
    residual = local.new_zeros(frames)
    for start in range(0, frames, CHUNK_FRAMES):
        part = slice(start, start + CHUNK_FRAMES)
        part_offsets = offsets[part] if offsets.dim() == 3 else offsets
        base = _base_of(chain, local[part], roots[part], part_offsets, parents, root)
        pose, residual[part] = _solve_frames(targets[part], chain, base, options)
        turned = roma.rotmat_to_rotvec(base.local.transpose(-1, -2) @ pose.local)
        turns[part, chain.joints] = turned
        shifts[part] = pose.root - base.root
    seen = torch.zeros(joints, dtype=torch.bool, device=local.device)
    seen[chain.joints] = chain.below.sum(-1) > 0
    return Corrections(turns, shifts, seen, residual)


def _build_chain(binding: Binding, parents: np.ndarray, root: int, options: SolveOptions) -> _Chain:
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
    below = torch.zeros(len(joints), len(bones), device=device)
    for joint in joints:
        rows = torch.tensor([place[one] for one in above[joint]], device=device)
        below[rows[:, None], torch.nonzero(tied & (bones == place[joint])).T] = 1.0
    pairs = [(place[one], place[joint]) for joint in joints for one in above[joint]]
    scale = REFERENCE_POINTS / max(len(bones), 1) / options.point_noise_m**2

    def indices(values: list[int]) -> Tensor:
        return torch.tensor(values, dtype=torch.long, device=device)

    return _Chain(
        joints=indices(joints),
        levels=[
            (indices([place[j] for j in level]), indices([place[int(parents[j])] for j in level]))
            for _, level in sorted(levels.items())
        ],
        below=below,
        upper=indices([pair[0] for pair in pairs]),
        lower=indices([pair[1] for pair in pairs]),
        bones=bones,
        in_bone=binding.in_bone,
        weights=binding.weights * tied * scale,
    )


def _base_of(chain: _Chain, local: Tensor, roots: Tensor, offsets: Tensor, parents: np.ndarray, root: int) -> _Base:
    frames = local.shape[0]
    # Joints above the pelvis never move in the solve: fold them into the pelvis' own transform.
    lead = root + 1  # parents come before children, so the pelvis' ancestors are among these
    rotations = global_rotations(local[:, :lead], parents[:lead])
    heads = joint_positions(rotations, roots, offsets[..., :lead, :], parents[:lead])
    chain_local = local[:, chain.joints].clone()
    chain_local[:, 0] = rotations[:, root]
    chain_offsets = offsets.expand(frames, -1, 3)[:, chain.joints]
    return _Base(roma.unitquat_to_rotmat(chain_local), heads[:, root], chain_offsets)


def _solve_frames(targets: Tensor, chain: _Chain, base: _Base, options: SolveOptions) -> tuple[_Pose, Tensor]:
    """Levenberg's damping, one factor for each frame: a step that raises a frame's cost is taken back."""
    pose = _Pose(base.local, base.root)
    system = _linearise(targets, pose, chain, base, options)
    damping = torch.full_like(system.cost, 1e-3)
    for _ in range(options.iterations):
        diagonal = torch.diagonal(system.matrix, dim1=-2, dim2=-1)
        damped = system.matrix + torch.diag_embed(damping[:, None] * diagonal)
        factor, _ = torch.linalg.cholesky_ex(damped)
        step = torch.cholesky_solve(system.pull.unsqueeze(-1), factor).squeeze(-1)
        trial = _move(pose, step, chain)
        outcome = _linearise(targets, trial, chain, base, options)
        better = outcome.cost <= system.cost  # False for NaN, which keeps the last good pose
        pose = _Pose(*(_choose(better, new, old) for new, old in zip(trial, pose, strict=True)))
        system = _System(*(_choose(better, new, old) for new, old in zip(outcome, system, strict=True)))
        damping = torch.where(better, damping * 0.2, damping * 10.0)
        if bool((step.abs().amax(-1) < SETTLED).all()):
            break
    return pose, system.residual


def _choose(mask: Tensor, yes: Tensor, no: Tensor) -> Tensor:
    return torch.where(mask.view(-1, *[1] * (yes.dim() - 1)), yes, no)


def _forward(pose: _Pose, chain: _Chain, base: _Base) -> tuple[Tensor, Tensor]:
    """Global rotations (T, A, 3, 3) and heads (T, A, 3) of the chain."""
    rotations, heads = pose.local.clone(), torch.empty_like(base.offsets)
    heads[:, 0] = pose.root
    for children, parents in chain.levels:
        above = rotations[:, parents]
        heads[:, children] = heads[:, parents] + (above @ base.offsets[:, children].unsqueeze(-1)).squeeze(-1)
        rotations[:, children] = above @ pose.local[:, children]
    return rotations, heads


def _move(pose: _Pose, step: Tensor, chain: _Chain) -> _Pose:
    """Apply a step (T, 3 + 3A): the shift in world axes, the turns in the joints' own axes."""
    turns = roma.rotvec_to_rotmat(step[:, 3:].reshape(len(step), -1, 3))
    return _Pose(pose.local @ turns, pose.root + step[:, :3])


def _cross_matrix(v: Tensor) -> Tensor:
    """(..., 3) to the matrix (..., 3, 3) that takes u to v x u."""
    x, y, z = v.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))


def _linearise(targets: Tensor, pose: _Pose, chain: _Chain, base: _Base, options: SolveOptions) -> _System:
    rotations, heads = _forward(pose, chain, base)
    arms = (rotations[:, chain.bones] @ chain.in_bone.unsqueeze(-1)).squeeze(-1)
    # Around the pelvis, so that float32 loses nothing where the motion is far from the origin.
    centre = pose.root.unsqueeze(1)
    points = heads[:, chain.bones] - centre + arms
    heads = heads - centre
    misses = targets - centre - points
    distance = misses.norm(dim=-1)
    weights = chain.weights * (options.huber_m / distance.clamp(min=options.huber_m))

    moments = torch.cat(
        [
            weights.unsqueeze(-1),
            weights.unsqueeze(-1) * points,
            (weights.unsqueeze(-1) * points).unsqueeze(-1).mul(points.unsqueeze(-2)).flatten(-2),
            weights.unsqueeze(-1) * misses,
            weights.unsqueeze(-1) * torch.linalg.cross(points, misses),
        ],
        dim=-1,
    )
    mass, first, second, force, torque = (chain.below @ moments).split([1, 3, 9, 3, 3], dim=-1)
    matrix = _evidence(mass, first, second.unflatten(-1, (3, 3)), heads, rotations, chain)
    torque = torque - torch.linalg.cross(heads, force)
    torque = (rotations.transpose(-1, -2) @ torque.unsqueeze(-1)).squeeze(-1)
    pull = torch.cat([force[:, 0], torque.flatten(1)], dim=-1)

    turned = roma.rotmat_to_rotvec(base.local.transpose(-1, -2) @ pose.local)
    shifted = pose.root - base.root
    strength = torch.full_like(pull, options.turn_prior_rad**-2)
    strength[:, :3] = options.shift_prior_m**-2
    from_base = torch.cat([shifted, turned.flatten(1)], dim=-1)
    matrix = matrix + torch.diag_embed(strength)
    pull = pull - strength * from_base

    inside = distance.clamp(max=options.huber_m)
    fit = (chain.weights * inside * (distance - inside / 2)).sum(-1)
    cost = fit + (strength * from_base**2).sum(-1) / 2
    total = weights.sum(-1).clamp(min=1e-12)
    residual = ((weights * distance**2).sum(-1) / total).sqrt()
    return _System(matrix, pull, cost, residual)


def _evidence(mass: Tensor, first: Tensor, second: Tensor, heads: Tensor, rotations: Tensor, chain: _Chain) -> Tensor:
    """The points' part of the normal matrix, (T, 3 + 3A, 3 + 3A), from subtree moments (T, A, ...).

    For a joint i and its descendant j only the points below j count: the block is the sum of
    `(a . b) I - b a'` with a = p - head_i and b = p - head_j, turned into both joints' own axes.
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
    full = mass.new_zeros(frames, joints + 1, joints + 1, 3, 3)
    full[:, upper + 1, lower + 1] = block
    full[:, lower + 1, upper + 1] = block.transpose(-1, -2)
    # The shift moves every point alike: against turn_i it gives -sum [a]x.
    against = -_cross_matrix(first - mass * heads) @ rotations
    full[:, 0, 1:] = against
    full[:, 1:, 0] = against.transpose(-1, -2)
    full[:, 0, 0] = mass[:, 0, :, None] * torch.eye(3, device=mass.device, dtype=mass.dtype)
    return full.permute(0, 1, 3, 2, 4).reshape(frames, 3 * joints + 3, 3 * joints + 3)
