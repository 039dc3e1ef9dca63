"""The methods that are measured: nothing, the plain filters, mending without a model, networks and priors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from data_schemas.skeleton import Motion
from stages.shared.inference.cloud_sources import ReconstructedClouds
from stages.shared.inference.latent_denoiser import LatentDenoiser
from stages.shared.inference.latent_denoising import (
    LatentOptions,
    TrueDifferences,
    corrections_by,
    denoised_by_latents,
    scene_of,
)
from stages.shared.inference.models import Models
from stages.shared.inference.pose_denoising import body_of
from stages.shared.inference.pose_filling import Interpolator
from stages.shared.inference.pose_model import PoseModel, blended
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward import local_rotations
from stages.shared.kinematics.motion_filters import FILTERS, Filter, filter_rotations
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.denoise import DenoiseTask, limbs_of_rig, pose_of_local
from stages.shared.solve.robust_smoothing import mend_poses
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.statistics.metrics import mpjpe_mm

NOISY, MEND = "noisy", "mend"
TRUE_LATENTS, TRUE_CLOUDS = "true latents", "true clouds"


@dataclass(frozen=True)
class NoisyWindows:
    """Windows (B, T) of the rig's body at 30 frames a second, in the world: with noise, the same after `mend_poses`,
    and the truth, which only `oracle_cleaner` reads."""

    noisy: BodyPose
    mended: BodyPose
    truth: BodyPose

    @classmethod
    def of(cls, rig: Rig, noisy: BodyPose, truth: BodyPose) -> NoisyWindows:
        limbs = limbs_of_rig(rig)
        found = [mend_poses(turns, root, limbs=limbs) for root, turns in zip(*_local(rig, noisy), strict=True)]
        mended = pose_of_local([(each.positions, each.local) for each in found], rig.body.parents)
        return cls(noisy, mended, truth)


Cleaner = Callable[[NoisyWindows], BodyPose]
"""Noisy windows in, clean ones (B, T) out, in the world."""


def filtered(rig: Rig, noisy: BodyPose, chosen: Filter, width: float) -> BodyPose:
    """A plain filter of the root and of the local rotations."""
    roots, local = _local(rig, noisy)
    made = [
        (chosen(root, MODEL_FPS, width), filter_rotations(turns, MODEL_FPS, chosen, width))
        for root, turns in zip(roots, local, strict=True)
    ]
    return pose_of_local(made, rig.body.parents)


def filter_cleaner(rig: Rig, chosen: Filter, width: float) -> Cleaner:
    """`filtered`, for a width."""
    return lambda seen: filtered(rig, seen.noisy, chosen, width)


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

    def clean(seen: NoisyWindows) -> BodyPose:
        noisy = seen.noisy
        made = [one(BodyPose(noisy.roots[i : i + 1], noisy.rotations[i : i + 1])) for i in range(len(noisy.roots))]
        return BodyPose.joined(made)

    return clean


def latent_cleaner(rig: Rig, denoiser: LatentDenoiser) -> Cleaner:
    """`pumps denoise --method latent`."""

    def clean(seen: NoisyWindows) -> BodyPose:
        starts = zip(_motions(rig, seen.noisy), _motions(rig, seen.mended), strict=True)
        return _bodies(rig, [denoised_by_latents(denoiser, rig.skeleton, *each) for each in starts])

    return clean


def oracle_cleaner(rig: Rig, models: Models, kind: str) -> Cleaner:
    """`pumps denoise --method latent` with the true latents or the true clouds instead of the denoiser's: the result
    has the errors of the autoencoder and the solve, or of the solve alone."""

    def clean(seen: NoisyWindows) -> BodyPose:
        made = []
        for mended, true in zip(_motions(rig, seen.mended), _motions(rig, seen.truth), strict=True):
            pose = SkeletonPose.of_motion(rig.skeleton, mended)
            scene = scene_of(pose, np.arange(float(mended.frames)), mended.fps)
            clouds = (
                ReconstructedClouds(models, true)
                if kind == TRUE_LATENTS
                else TrueDifferences(SkeletonPose.of_motion(rig.skeleton, true))
            )
            found = corrections_by(clouds, scene, LatentOptions())
            made.append(pose.corrected(found.turns, found.shifts).motion(mended.fps))
        return _bodies(rig, made)

    return clean


def _motions(rig: Rig, pose: BodyPose) -> list[Motion]:
    """Each window as a motion of the rig."""
    return [rig.motion(roots, turns, MODEL_FPS) for roots, turns in zip(pose.roots, pose.rotations, strict=True)]


def _bodies(rig: Rig, motions: Sequence[Motion]) -> BodyPose:
    return BodyPose.joined([body_of(rig.skeleton, each, rig.body.joints) for each in motions])


def prior_cleaner(rig: Rig, prior: Interpolator) -> Cleaner:
    """A prior of poses or motion, lowered by gradient descent that starts from the noisy motion."""

    def clean(seen: NoisyWindows) -> BodyPose:
        heads, rotations = prior.denoise(seen.noisy.heads(rig.body), seen.noisy.rotations)
        return BodyPose(heads[:, :, 0], rotations)

    return clean


def best_widths(
    rig: Rig, names: tuple[str, ...], widths: tuple[float, ...], noisy: BodyPose, clean: BodyPose
) -> Mapping[str, float]:
    """Of each filter the width with the smallest MPJPE over windows (B, T)."""
    found = {}
    for name in names:
        errors = [
            float(mean_errors(rig, filtered(rig, noisy, FILTERS[name], width), clean).mean()) for width in widths
        ]
        found[name] = widths[int(np.argmin(errors))]
    return found


def mean_errors(rig: Rig, made: BodyPose, truth: BodyPose) -> np.ndarray:
    """(B,) MPJPE of windows, mm."""
    return mpjpe_mm(*(pose.heads(rig.body).double().numpy() for pose in (made, truth)))


def _local(rig: Rig, pose: BodyPose) -> tuple[np.ndarray, np.ndarray]:
    local = local_rotations(pose.rotations, rig.body.parents).double().numpy()
    return pose.roots.double().numpy(), local / np.linalg.norm(local, axis=-1, keepdims=True)
