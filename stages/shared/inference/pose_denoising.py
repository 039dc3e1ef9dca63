"""A rig's own network for denoising, in use on clips of the rig at any rate."""

from __future__ import annotations

import numpy as np
import torch

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.pose_model import PoseModel, blended
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward import local_rotations
from stages.shared.kinematics.rotations import turns_between
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.denoise import DenoiseTask
from stages.shared.solve.skeleton_pose import SkeletonPose


def refined(model: PoseModel, skeleton: Skeleton, noisy: Motion, mended: Motion) -> Motion:
    """The network's motion. Joints that are not of the rig's body keep the mended motion's rotations.

    Raises: InputError if the skeleton is not the rig's.
    """
    check_rig(model, skeleton)
    task, joints = model.task, model.rig.body.joints
    assert isinstance(task, DenoiseTask)
    seen, start = (body_of(skeleton, motion, joints) for motion in (noisy, mended))
    pace = MODEL_FPS / noisy.fps
    window = max(4, round(model.window / pace))

    def made(first: int, stop: int) -> BodyPose:
        part = slice(first, stop)
        given = torch.ones(1, stop - first, dtype=torch.bool)
        parts = [pose.frames(part) for pose in (seen, start)]
        shown = task.see(parts[0], given, mended=parts[1])
        times = torch.arange(stop - first).float().unsqueeze(0) * pace
        return model.pose(shown.features, shown.given, shown.base, times).back(shown.yaw, shown.centre)

    found = blended(noisy.frames, window, made)
    pose = SkeletonPose.of_motion(skeleton, mended)
    local = local_rotations(
        pose.rotations.clone().index_copy(1, torch.as_tensor(joints), found.rotations[0]), skeleton.parents
    )
    turns = torch.zeros(noisy.frames, skeleton.joints, 3)
    turns[:, joints] = turns_between(pose.local, local)[:, joints]
    shifts = found.roots[0] - pose.heads[:, skeleton.root]
    return pose.corrected(turns, shifts).motion(noisy.fps)


def body_of(skeleton: Skeleton, motion: Motion, joints: np.ndarray) -> BodyPose:
    """The body's pose (1, T) of a motion."""
    pose = SkeletonPose.of_motion(skeleton, motion)
    return BodyPose(pose.heads[None, :, skeleton.root], pose.rotations[None, :, joints])


def check_rig(model: PoseModel, skeleton: Skeleton) -> None:
    """Raise InputError if a network's rig is another than a skeleton."""
    own = model.rig.skeleton
    if not fits_rig(model, skeleton):
        raise InputError(
            f"The network was trained for a rig of {own.joints} joints ({own.names[0]}, ...), and the motion has "
            f"{skeleton.joints} joints ({skeleton.names[0]}, ...).",
            "Give weights that were fine-tuned on this rig, or leave --weights out.",
        )


def fits_rig(model: PoseModel, skeleton: Skeleton) -> bool:
    """Whether a skeleton has the joints of a network's rig."""
    own = model.rig.skeleton
    return skeleton.names == own.names and bool((np.asarray(skeleton.parents) == own.parents).all())
