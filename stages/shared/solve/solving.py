"""From a moving cloud to a pose: damped Gauss-Newton on the joints' rotations, all frames at once (DESIGN 6.6).

Every point is bound to a bone (`stages.shared.solve.binding`). The unknowns of a frame are a rotation vector for
every joint that moves a point, in the joint's own frame after its base rotation, and a shift of the pelvis
(`stages.shared.solve.solve_equations`). A prior pulls every correction to zero: joints without points stay at the
base pose, and joints that the points determine badly move little. Huber weights keep outliers from pulling a limb
away.

A cloud of another body does not fit the skeleton's bone lengths. Then every bone's points may be off by a common
shift of their own (`SolveOptions.slack_m`): then only the bone's rotation is fitted, not its position.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.rotations import from_matrices, turn_vectors
from stages.shared.solve.binding import Binding
from stages.shared.solve.rigid_start import rigid_start
from stages.shared.solve.solve_equations import (
    Base,
    Chain,
    Pose,
    SolveOptions,
    System,
    base_of,
    build_chain,
    linearise,
    misfit,
    move,
)

__all__ = ["Corrections", "SolveOptions", "solve_pose"]

CHUNK_FRAMES = 512  # frames solved together; bounds the memory of a long clip
SETTLED = 1e-4  # radians and metres; a frame whose step is below this is done
FEWER = 0.8  # if less than this share of the frames still moves, the others are left out


class Corrections(NamedTuple):
    """Corrections that the solve adds to a base pose.

    turns:    (T, J, 3) rotation vectors, radians: local rotation = base * exp(turn). Zero for joints without points.
    shifts:   (T, 3) of the pelvis in the world, metres.
    seen:     (J,) bool, True for joints at or above the bone of some point.
    residual: (T,) weighted root mean square distance that remains between points and targets, metres.
    """

    turns: Tensor
    shifts: Tensor
    seen: Tensor
    residual: Tensor


def solve_pose(
    targets: Tensor,
    binding: Binding,
    local: Tensor,
    roots: Tensor,
    offsets: Tensor,
    parents: np.ndarray,
    root: int = 0,
    options: SolveOptions | None = None,
    turn_prior: Tensor | None = None,
) -> Corrections:
    """Corrections to a base pose that move the bound points to their targets.

    Args:
        targets: (T, P, 3) target positions of the points, metres.
        binding: the bone of every point and its position in the bone's frame.
        local: (T, J, 4) base rotations in the parents' frames, unit quaternions xyzw.
        roots: (T, 3) base positions of joint 0.
        offsets: (T, J, 3) or (J, 3) joints' heads in their parents' frames.
        parents: (J,), parents before children.
        root: the pelvis; joints above it do not move.
        options: strength of the prior and the like.
        turn_prior: (J, 3, 3) precision of every joint's turn in its own axes, 1 / radians^2, if more is known than
            `options.turn_prior_rad` (`stages.shared.solve.key_prior`).

    Returns: Corrections, float32. Bones outside the pelvis' subtree are not solved.
    """
    options = options or SolveOptions()
    chain = build_chain(binding, np.asarray(parents), root, options, turn_prior)
    frames, joints = local.shape[:2]
    turns = local.new_zeros(frames, joints, 3)
    shifts = local.new_zeros(frames, 3)
    residual = local.new_zeros(frames)
    for start in range(0, frames, CHUNK_FRAMES):
        part = slice(start, start + CHUNK_FRAMES)
        part_offsets = offsets[part] if offsets.dim() == 3 else offsets
        base = base_of(chain, local[part], roots[part], part_offsets, parents, root)
        pose, residual[part] = _solve_frames(targets[part], chain, base, options)
        turned = turn_vectors(from_matrices(base.local.transpose(-1, -2) @ pose.local))
        turns[part, chain.joints] = turned
        shifts[part] = pose.root - base.root
    seen = torch.zeros(joints, dtype=torch.bool, device=local.device)
    seen[chain.joints] = (chain.below @ chain.riding).sum(-1) > 0
    return Corrections(turns, shifts, seen, residual)


def _solve_frames(targets: Tensor, chain: Chain, base: Base, options: SolveOptions) -> tuple[Pose, Tensor]:
    """Levenberg's damping, one factor for each frame: a step that raises a frame's cost is undone."""
    pose = Pose(base.local, base.root)
    if options.rigid_start:
        rigid = rigid_start(targets, chain, base)
        nearer = misfit(targets, rigid, chain, base, options) < misfit(targets, pose, chain, base, options)
        pose = Pose(*(_choose(nearer, new, old) for new, old in zip(rigid, pose, strict=True)))
    system = linearise(targets, pose, chain, base, options)
    damping = torch.full_like(system.cost, 1e-3)
    done, residual = pose, system.residual  # of all frames; `pose` and `system` are of those that still move
    moving = torch.arange(len(targets), device=targets.device)
    for _ in range(options.iterations):
        step = _damped_step(system, damping)
        trial = move(pose, step, chain)
        outcome = linearise(targets, trial, chain, base, options)
        better = outcome.cost <= system.cost  # False for NaN, which keeps the last good pose
        pose = Pose(*(_choose(better, new, old) for new, old in zip(trial, pose, strict=True)))
        system = _better_of(better, outcome, system)
        damping = torch.where(better, damping * 0.2, damping * 10.0)
        done = Pose(*(_placed(all_, moving, part) for all_, part in zip(done, pose, strict=True)))
        residual = _placed(residual, moving, system.residual)
        if step.is_cuda:
            continue  # reading from a GPU which frames have converged would wait for it; the last steps are cheaper
        left = torch.nonzero(step.abs().amax(-1) >= SETTLED).squeeze(-1)
        if len(left) == 0:
            break
        if len(left) < FEWER * len(moving):
            moving, targets, damping = moving[left], targets[left], damping[left]
            pose, base = Pose(*(part[left] for part in pose)), Base(*(part[left] for part in base))
            system = System(*(part[left] for part in system))
    return done, residual


def _damped_step(system: System, damping: Tensor) -> Tensor:
    """(T, 3 + 3A) the step of equations whose diagonal is larger by the factor 1 + damping (T,)."""
    damped = system.matrix.clone()
    diagonal = torch.diagonal(damped, dim1=-2, dim2=-1)
    diagonal += damping[:, None] * diagonal
    factor, _ = torch.linalg.cholesky_ex(damped)
    return torch.cholesky_solve(system.pull.unsqueeze(-1), factor).squeeze(-1)


def _better_of(better: Tensor, new: System, old: System) -> System:
    """`new` in the frames in which it is better (T,), elsewhere `old`; the matrices, which are large, in place."""
    if better.is_cuda:  # which frames are worse is not known here without waiting for the GPU
        return System(*(_choose(better, one, other) for one, other in zip(new, old, strict=True)))
    worse = torch.nonzero(~better).squeeze(-1)
    new.matrix[worse] = old.matrix[worse]
    rest = (_choose(better, one, other) for one, other in zip(new[1:], old[1:], strict=True))
    return System(new.matrix, *rest)


def _placed(whole: Tensor, rows: Tensor, part: Tensor) -> Tensor:
    """`whole` with some rows from `part`; `part` itself if these are all rows."""
    return part if len(part) == len(whole) else whole.index_copy(0, rows, part)


def _choose(mask: Tensor, yes: Tensor, no: Tensor) -> Tensor:
    return torch.where(mask.view(-1, *[1] * (yes.dim() - 1)), yes, no)
