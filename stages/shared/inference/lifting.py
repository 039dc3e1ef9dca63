"""2D keypoints to motion on the rig of a trained lifter (the task `estimate`), with the camera that saw it.

The network finds the pose of each frame in windows that are blended. The camera's pitch and roll, its focal length if
that is unknown, and the body's path follow from the pose and the keypoints (`stages.shared.solve.reprojection`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion
from stages.shared.formats.keypoint_layouts import landmark_tracks
from stages.shared.formats.keypoints import Keypoints
from stages.shared.inference.pose_model import PoseModel, blended
from stages.shared.inference.pose_refining import refine_pose
from stages.shared.kinematics.cameras import DEFAULT_FOV_DEG, Intrinsics, intrinsics_of_fov, level_camera
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.foot_contacts import find_feet, floor_levels
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.resampling import resample
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.estimate import OF_JOINTS, EstimateTask, see_keypoints
from stages.shared.solve.reprojection import SolvedView, solve_view

_LEAST_POINTS = 6


@dataclass(frozen=True)
class PlacedCamera:
    """A camera that stands still in the world of a motion.

    position: (3,) metres. rotation: (4,) xyzw, of its axes (x right, y down, z forward) in the world.
    intrinsics: focal length and principal point.
    """

    position: np.ndarray
    rotation: np.ndarray
    intrinsics: Intrinsics


@dataclass(frozen=True)
class Lifted:
    """motion: on the lifter's rig, level, the floor at height 0, its first frame above the origin.

    camera: the one that saw it.
    error: (T,) distance between keypoints and the result projected, metres at the body's distance, root mean square;
    NaN in frames without keypoints. view: the solved camera and path.
    """

    motion: Motion
    camera: PlacedCamera
    error: np.ndarray
    view: SolvedView


def assumed_intrinsics(keypoints: Keypoints, size: tuple[float, float] | None) -> Intrinsics:
    """A camera of an ordinary field of view; without an image size, its middle is that of the keypoints."""
    if size is not None:
        larger = max(size)
        found = intrinsics_of_fov(DEFAULT_FOV_DEG, (larger, larger))
        return Intrinsics(found.focal_px, (size[0] / 2, size[1] / 2))
    there = keypoints.places[keypoints.confidences > 0]
    low, high = np.percentile(there, [1, 99], axis=0)
    middle = (low + high) / 2
    span = 1.5 * float((high - low).max())
    return Intrinsics(intrinsics_of_fov(DEFAULT_FOV_DEG, (span, span)).focal_px, (float(middle[0]), float(middle[1])))


def lift(model: PoseModel, keypoints: Keypoints, intrinsics: Intrinsics, *, known: bool, fps: float) -> Lifted:
    """The motion of one person's keypoints.

    Args:
        model: of the task `estimate`. known: False if the focal length is assumed. fps: of the keypoints.
    Raises: InputError if the network was trained on a rig's joints, or no frame has enough landmarks.
    """
    task = model.task
    assert isinstance(task, EstimateTask)
    if task.corruption in OF_JOINTS:
        raise InputError(
            "These weights were trained on the projected joints of a rig, which no pose detector gives.",
            "Train with --corruption detector.",
        )
    places, trust = landmark_tracks(keypoints.names, keypoints.places, keypoints.confidences)
    if not ((trust > 0).sum(axis=1) >= _LEAST_POINTS).any():
        raise InputError(
            f"No frame has {_LEAST_POINTS} points that are landmarks of a body.",
            "Shoulders, elbows, wrists, hips, knees and ankles are needed.",
        )
    frames = len(places)
    rays, trust = _at_model_rate(intrinsics.rays(places), trust, fps)
    pose = _posed(model, task, rays, trust, known)
    rig = model.rig
    view = solve_view(_landmarks_of(task, pose.rotations), rays, trust, fps=MODEL_FPS, known=known)
    rotations = refine_pose(rig.body, task.landmarks, pose.rotations[0], view, rays, trust)
    view = solve_view(_landmarks_of(task, rotations[None]), rays, trust, fps=MODEL_FPS, known=known)
    motion = rig.motion(torch.from_numpy(view.path).float(), rotations, MODEL_FPS)
    motion = resample(motion, fps)
    motion = motion.at(slice(0, frames))
    moved, shift = _on_floor(model, motion)
    focal = intrinsics.focal_px * view.zoom
    camera = PlacedCamera(
        shift, level_camera(np.array(view.pitch), np.array(view.roll)), Intrinsics(focal, intrinsics.centre)
    )
    times = np.minimum(np.round(np.arange(frames) * MODEL_FPS / fps).astype(int), len(view.error) - 1)
    return Lifted(moved, camera, view.error[times], view)


def _landmarks_of(task: EstimateTask, rotations: torch.Tensor) -> np.ndarray:
    """(T, L, 3) landmarks of poses (1, T, J, 4), from the root, metres."""
    return task.landmark_places(BodyPose(torch.zeros(*rotations.shape[:2], 3), rotations))[0].double().numpy()


def _at_model_rate(rays: np.ndarray, trust: np.ndarray, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Tracks at the model's rate, up to the first model frame at or after the last frame; a point is there where both
    of its neighbours in time are."""
    if fps == MODEL_FPS:
        return rays, trust
    count = int(np.ceil((len(rays) - 1) * MODEL_FPS / fps - 1e-6)) + 1
    times = np.minimum(np.arange(count) * fps / MODEL_FPS, len(rays) - 1)
    below = np.floor(times + 1e-9).astype(int)
    above = np.minimum(below + 1, len(rays) - 1)
    share = (times - below)[:, None]
    exact = share < 1e-6
    mixed = rays[below] + share[..., None] * (rays[above] - rays[below])
    mixed = np.where(exact[..., None], rays[below], mixed)
    both = np.where(exact, trust[below], np.minimum(trust[below], trust[above]))
    return mixed, np.where(np.isfinite(mixed).all(-1), both, 0.0)


def _posed(model: PoseModel, task: EstimateTask, rays: np.ndarray, trust: np.ndarray, known: bool) -> BodyPose:
    """Poses (1, T) in a level frame that is seen along the camera's axis, with the root at the origin."""

    def of_window(start: int, stop: int) -> BodyPose:
        seen = see_keypoints(rays[None, start:stop], trust[None, start:stop], np.array([known]))
        times = torch.arange(float(stop - start)).unsqueeze(0)
        made = model.pose(seen.features, seen.given, task.base(1, stop - start), times)
        # The window's frame faces the camera from where the body is; the camera's axis points elsewhere.
        yaw = torch.atan2(-seen.middle[:, 0].float(), torch.ones(1))
        made = made.placed(yaw, torch.zeros(1, 3))
        return BodyPose(torch.zeros_like(made.roots), made.rotations)

    return blended(len(rays), model.window, of_window)


def _on_floor(model: PoseModel, motion: Motion) -> tuple[Motion, np.ndarray]:
    """The motion with its feet on the floor and its first frame above the origin, and the shift (3,)."""
    skeleton = model.rig.skeleton
    heads = positions_of(skeleton, motion)
    floor = float(floor_levels(heads, find_feet(skeleton)).min())
    first = heads[0, skeleton.root]
    shift = np.array([-first[0], -floor, -first[2]])
    return Motion(motion.rotations, (motion.root_positions + shift).astype(np.float32), motion.fps), shift
