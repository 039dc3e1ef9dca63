"""The methods that are measured: nothing, the plain filters, mending without a model, networks and priors."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch

from stages.shared.inference.pose_filling import Interpolator
from stages.shared.inference.pose_model import PoseModel, blended
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward import local_rotations
from stages.shared.kinematics.motion_filters import FILTERS, Filter, filter_rotations
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.denoise import DenoiseTask, pose_of_local
from stages.shared.solve.robust_smoothing import mend_poses
from stages.shared.statistics.metrics import mpjpe_mm

NOISY, MEND = "noisy", "mend"
Cleaner = Callable[[BodyPose], BodyPose]
"""Noisy windows (B, T) of the rig's body at 30 frames a second in, clean ones out, both in the world."""


def filter_cleaner(rig: Rig, chosen: Filter, width: float) -> Cleaner:
    """A plain filter of the root and of the local rotations."""

    def clean(noisy: BodyPose) -> BodyPose:
        roots, local = _local(rig, noisy)
        made = [
            (chosen(root, MODEL_FPS, width), filter_rotations(turns, MODEL_FPS, chosen, width))
            for root, turns in zip(roots, local, strict=True)
        ]
        return pose_of_local(made, rig.body.parents)

    return clean


def mending_cleaner(rig: Rig) -> Cleaner:
    """`mend_poses`, which `pumps denoise` runs without weights."""

    def clean(noisy: BodyPose) -> BodyPose:
        found = [mend_poses(turns, root) for root, turns in zip(*_local(rig, noisy), strict=True)]
        return pose_of_local([(each.positions, each.local) for each in found], rig.body.parents)

    return clean


def network_cleaner(model: PoseModel) -> Cleaner:
    """A fine-tuned network, on windows of its training's length that are blended."""
    task = model.task
    assert isinstance(task, DenoiseTask)

    def one(noisy: BodyPose) -> BodyPose:
        def of_window(start: int, stop: int) -> BodyPose:
            part = slice(start, stop)
            given = torch.ones(1, stop - start, dtype=torch.bool)
            seen = task.see(noisy.frames(part), given)
            times = torch.arange(float(stop - start)).unsqueeze(0)
            return model.pose(seen.features, seen.given, seen.base, times).back(seen.yaw, seen.centre)

        return blended(noisy.roots.shape[1], max(model.window, 2), of_window)

    def clean(noisy: BodyPose) -> BodyPose:
        made = [one(BodyPose(noisy.roots[i : i + 1], noisy.rotations[i : i + 1])) for i in range(len(noisy.roots))]
        return BodyPose.joined(made)

    return clean


def prior_cleaner(rig: Rig, prior: Interpolator) -> Cleaner:
    """A prior of poses or motion, lowered by gradient descent that starts from the noisy motion."""

    def clean(noisy: BodyPose) -> BodyPose:
        heads, rotations = prior.denoise(noisy.heads(rig.body), noisy.rotations)
        return BodyPose(heads[:, :, 0], rotations)

    return clean


def best_widths(
    rig: Rig, names: tuple[str, ...], widths: tuple[float, ...], noisy: BodyPose, clean: BodyPose
) -> Mapping[str, float]:
    """Of each filter the width with the smallest MPJPE over windows (B, T)."""
    found = {}
    for name in names:
        errors = [
            float(mean_errors(rig, filter_cleaner(rig, FILTERS[name], width)(noisy), clean).mean())
            for width in widths
        ]
        found[name] = widths[int(np.argmin(errors))]
    return found


def mean_errors(rig: Rig, made: BodyPose, truth: BodyPose) -> np.ndarray:
    """(B,) MPJPE of windows, mm."""
    return mpjpe_mm(*(pose.heads(rig.body).double().numpy() for pose in (made, truth)))


def _local(rig: Rig, pose: BodyPose) -> tuple[np.ndarray, np.ndarray]:
    local = local_rotations(pose.rotations, rig.body.parents).double().numpy()
    return pose.roots.double().numpy(), local / np.linalg.norm(local, axis=-1, keepdims=True)
