"""The gaps of filled windows as equations of trust: what corrections do, beside what they should do."""

from __future__ import annotations

import numpy as np
import torch

from data_schemas.skeleton import Motion
from stages.shared.inference.cloud_interfaces import Scene
from stages.shared.inference.confidence import gap_sizes, part_joints
from stages.shared.inference.trust_fit import Sums
from stages.shared.kinematics.rotations import turns_between
from stages.shared.solve.skeleton_pose import SkeletonPose, pose_of_motion
from stages.shared.solve.solving import Corrections

ANGLE_M = 0.1  # weight of an angle: an error of a radian counts as one of ten centimetres


def add_gaps(scene: Scene, made: Corrections, motion: Motion, *pairs: tuple[Sums, Corrections]) -> None:
    """Compare a filled window's corrections with the ideal ones that reach the truth.

    Args:
        made: corrections before they are multiplied by a confidence. motion: the true window.
        pairs: equations that the window's gaps are added to, and the corrections that they compare with the
            ideal ones.
    """
    skeleton, tokens = scene.skeleton, scene.tokens
    frames = torch.arange(motion.frames, device=scene.device).double()
    truth = pose_of_motion(skeleton, motion, scene.device).at(frames, scene.times)
    wanted = change_of(scene, truth)
    sizes = [(gap, gap_sizes(tokens, gap, skeleton, made)) for gap in tokens.gaps()]
    for sums, used in pairs:
        changes = changes_by_part(scene, used)
        for gap, size in sizes:
            if np.isfinite(changes[:, gap]).all():
                sums.add(size.length_bin, size.size_bins.tolist(), size.depth, changes[:, gap], wanted[gap])


def change_of(scene: Scene, pose: SkeletonPose) -> np.ndarray:
    """(N, C) difference of a pose from the base: positions of the body's joints, metres, and angles times
    `ANGLE_M`."""
    skeleton, base = scene.skeleton, scene.base
    body = torch.as_tensor(skeleton.groups >= 0, device=scene.device)
    places = pose.heads[:, body] - base.heads[:, body]
    turns = turns_between(base.local, pose.local)[:, body]
    return torch.cat([places.flatten(1), ANGLE_M * turns.flatten(1)], -1).cpu().numpy()


def changes_by_part(scene: Scene, made: Corrections) -> np.ndarray:
    """(parts, N, C) the change from each of `PARTS` alone: the turns of its joints, or the pelvis' shift."""
    skeleton, found = scene.skeleton, []
    for joints in (*part_joints(skeleton, made), None):
        turns, shifts = torch.zeros_like(made.turns), torch.zeros_like(made.shifts)
        if joints is None:
            shifts = made.shifts
        else:
            turns[:, joints] = made.turns[:, joints]
        found.append(change_of(scene, scene.base.corrected(turns, shifts)))
    return np.stack(found)
