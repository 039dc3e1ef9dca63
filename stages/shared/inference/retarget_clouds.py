"""Retargeting by clouds: points of the source body, scaled to the target body's size, are targets for its joints.

Bones with the same rotations (`stages.shared.humanoid.retargeting`) end at other positions if two bodies are built
differently: a hand that rests on the hip may float in front of it. Points at corresponding positions on corresponding
bones give target positions for every part of the body. The solve finds the pose that is the best compromise between
these targets and the rotations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.bone_matching import LIMBS, bone_lengths, match_limb
from stages.shared.humanoid.retargeting import Retargeted
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.rotations import rotate
from stages.shared.pointcloud.sampling import draw_points
from stages.shared.solve.binding import Binding
from stages.shared.solve.skeleton_pose import pose_of_motion, replace_rows
from stages.shared.solve.solving import SolveOptions, solve_pose

# The turned bones are a good start: corrections are small.
SIGMA_M = 0.05
GENTLE = SolveOptions(point_noise_m=0.05, turn_prior_rad=0.2, shift_prior_m=0.05)


def pull_to_places(
    source: Skeleton,
    motion: Motion,
    target: Skeleton,
    turned: Retargeted,
    *,
    points: int = 256,
    seed: int = 0,
    options: SolveOptions = GENTLE,
    device: torch.device | str = "cpu",
) -> Motion:
    """The turned motion with hands, feet and the bones between them moved to their positions in the source, scaled to
    the target.

    Args:
        source, motion: the body that moves, T frames.
        target: the body that is to move. turned: the motion on the target from bone rotations alone.
        points: number of points to draw on the limbs.

    Returns: T frames on the target.
    """
    drawn = _answering_points(source, motion, target, turned, points, np.random.default_rng(seed))
    wanted = turned.in_targets_world(_carried(source, motion, drawn.source_bones, drawn.source_points))
    pose = pose_of_motion(target, turned.motion, device)
    binding = Binding(
        torch.as_tensor(drawn.target_bones, device=device),
        torch.as_tensor(drawn.target_points, dtype=torch.float32, device=device),
        torch.ones(points, device=device),
        torch.zeros(points, device=device),
    )
    targets = torch.as_tensor(wanted, dtype=torch.float32, device=device)
    solved = solve_pose(targets, binding, *pose.parts, target.parents, target.root, options)
    corrected = pose.corrected(solved.turns, solved.shifts)
    return replace_rows(target, turned.motion, corrected, np.arange(motion.frames))


class _MatchedPoints(NamedTuple):
    """P points on the limbs: the bone of each and its position in the bone's frame, on both bodies."""

    source_bones: np.ndarray
    source_points: np.ndarray
    target_bones: np.ndarray
    target_points: np.ndarray


def _answering_points(
    source: Skeleton,
    motion: Motion,
    target: Skeleton,
    turned: Retargeted,
    points: int,
    rng: np.random.Generator,
) -> _MatchedPoints:
    """Points at the same share of the length of corresponding pieces, and at the same position around them in the
    pose that both bodies share at the reference frame."""
    pieces = [piece for group in LIMBS for piece in match_limb(source, target, group)]
    lengths = np.array([bone_lengths(target, piece.target).sum() for piece in pieces])
    chosen, shares, around = draw_points(lengths, points, rng)
    theirs, ours = (_along(s, [p[i] for p in pieces], chosen, shares) for i, s in enumerate((source, target)))
    out = SIGMA_M * around  # in the frame of the target's bone
    world = Rotation.from_quat(turned.target_reference[ours.bones]).apply(out)
    back = Rotation.from_quat(turned.source_reference[theirs.bones]).inv().apply(world / turned.size)
    return _MatchedPoints(theirs.bones, theirs.points + back, ours.bones, ours.points + out)


class _Along(NamedTuple):
    bones: np.ndarray  # (P,)
    points: np.ndarray  # (P, 3) on the bones' lines, in their frames


def _along(skeleton: Skeleton, pieces: list[tuple[int, ...]], chosen: np.ndarray, shares: np.ndarray) -> _Along:
    """Positions at the given shares of the length of some pieces."""
    bones, points = np.empty(len(chosen), np.int64), np.empty((len(chosen), 3))
    for row, (piece, share) in enumerate(zip(chosen, shares, strict=True)):
        lengths = bone_lengths(skeleton, pieces[piece])
        ends = np.cumsum(lengths)
        at = min(int(np.searchsorted(ends, share * ends[-1])), len(ends) - 1)
        bones[row] = pieces[piece][at]
        within = (share * ends[-1] - (ends[at] - lengths[at])) / max(lengths[at], 1e-9)
        points[row] = within * skeleton.tails[bones[row]]
    return _Along(bones, points)


def _carried(skeleton: Skeleton, motion: Motion, bones: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(T, P, 3) positions of points bound to bones."""
    rotations = torch.as_tensor(motion.rotations[:, bones])
    moved = rotate(rotations, torch.as_tensor(points, dtype=torch.float32).expand(len(rotations), -1, 3))
    return positions_of(skeleton, motion)[:, bones] + moved.numpy()
