"""The task `estimate` (PUMPS 5.1): 2D keypoints of a body in, the motion of one rig out.

The pose is found in the view's frame: level, its origin at the window's mean root, seen along -Z by the camera. So it
does not depend on where camera and body stand, and a body that faces the camera faces +Z, as the rest pose does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from stages.shared.formats.keypoint_layouts import LAYOUTS, landmark_mask
from stages.shared.humanoid.detector_errors import DETECTOR, NONE, with_errors
from stages.shared.humanoid.landmarks import LANDMARKS, landmarks_of
from stages.shared.kinematics.cameras import in_camera, look_at, projected, random_place, view_yaw
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.rotations import aligned_signs, multiply, rotate
from stages.shared.networks.lifters.lifters import CAMERA_FEATURES
from stages.shared.pointcloud.rig import Rig, RigBody, pose_heads
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.mirrored import mirror_of_rig
from stages.shared.pose_tasks.task import PoseTask, TaskBatch, mean_norm

PAPER, MASKED, SEEN, DETECTED = "paper", "masked", "landmarks", "detector"
OF_JOINTS = (PAPER, MASKED)  # these show the rig's own joints, the others the landmarks of pose detectors
LEAST_POINTS = 4  # that a frame must have to be read
_ROOT_WEIGHT = 0.2  # of the root's path, which 2D keypoints of a body of unknown size determine badly
_VELOCITY_WEIGHT = 2.0  # of the joints' velocities, metres a frame
_MOST_STRETCHED = 1.3  # factor on the length of a bone
_MOVED_M = 0.015  # standard deviation of a landmark's place: a detector's hip is not exactly the rig's joint
_OFF_AXIS = 0.25  # how far the body's middle may lie from the image's, as a ray
_HIDDEN, _MOVED = 0.15, 0.02  # of the corruption `masked`: share of joints, and noise as a share of the person's size
_ROLL_RAD, _KNOWN = np.radians(2.0), 0.5  # of hand-held cameras; share of windows whose camera is known


@dataclass(frozen=True)
class SeenKeypoints:
    """What the network sees of windows: features (B, T, F) and given (B, T).

    middle: (B, 2) rays. size: (B,) root-mean-square distance of the points from it, in rays.
    """

    features: Tensor
    given: Tensor
    middle: Tensor
    size: Tensor


def see_keypoints(rays: np.ndarray, trust: np.ndarray, known: np.ndarray) -> SeenKeypoints:
    """The network's input.

    Args:
        rays: (B, T, K, 2) x / z and y / z in the camera's axes (or any multiple of them), NaN where missing.
        trust: (B, T, K) confidences, 0 where missing. known: (B,) False if the rays are of an assumed camera.
    """
    there = trust > 0
    places = np.where(there[..., None], rays, 0.0)
    count = np.maximum(there.sum(axis=(1, 2)), 1)
    middle = places.sum(axis=(1, 2)) / count[:, None]
    apart = np.where(there[..., None], rays - middle[:, None, None], 0.0)
    size = np.maximum(np.sqrt((apart**2).sum(axis=(1, 2, 3)) / count), 1e-9)
    points = np.concatenate([apart / size[:, None, None, None], trust[..., None]], axis=-1)
    camera = np.where(known[:, None], np.column_stack([middle, np.log(size), np.ones(len(size))]), 0.0)
    frames = rays.shape[1]
    features = np.concatenate(
        [points.reshape(*points.shape[:2], -1), np.repeat(camera[:, None], frames, axis=1)], axis=-1
    )
    given = there.sum(axis=-1) >= LEAST_POINTS
    empty = ~given.any(axis=1)
    given[empty] = True  # a window without any point: its features are zeros
    return SeenKeypoints(
        torch.from_numpy(features).float(), torch.from_numpy(given), torch.from_numpy(middle), torch.from_numpy(size)
    )


class EstimateTask(PoseTask):
    """Random cameras look at windows of the rig's motion; the outputs are added to the rest pose, facing the camera.

    `paper`: all joints of the rig, without errors, the window's mean root at the principal point (PUMPS 5.1).
    `masked`: the same with some joints missing and moved, to pre-train with (MotionBERT's way).
    `landmarks`: what pose detectors know, in their layouts; bodies of other proportions, cameras that do not aim.
    `detector`: the same with a detector's errors.
    """

    name: ClassVar[str] = "estimate"
    corruptions: ClassVar[tuple[str, ...]] = (PAPER, MASKED, SEEN, DETECTED)
    from_root: ClassVar[bool] = True

    def __init__(self, rig: Rig, corruption: str | None = None):
        super().__init__(rig, corruption)
        self.mirror = mirror_of_rig(rig) if self.corruption not in OF_JOINTS else None

    @property
    def points(self) -> int:
        """Number of keypoints that the network sees."""
        return len(self.rig.body.joints) if self.corruption in OF_JOINTS else len(LANDMARKS)

    @property
    def features(self) -> int:
        return 3 * self.points + CAMERA_FEATURES

    @cached_property
    def landmarks(self) -> tuple[np.ndarray, np.ndarray]:
        """(L,) bone of the body, and (L, 3) place in its frame, of every landmark; from the rest pose."""
        body, skeleton = self.rig.body, self.rig.skeleton
        rest = self.rig.motion(torch.zeros(1, 3), body.rest_world[None], 30.0)
        found = landmarks_of(skeleton, positions_of(skeleton, rest), rest.rotations)
        place = {int(joint): bone for bone, joint in enumerate(body.joints)}
        return np.array([place[int(joint)] for joint in found.bones]), found.offsets

    def landmark_places(self, pose: BodyPose) -> Tensor:
        """(B, T, L, 3) landmarks of poses of the rig, metres."""
        bones, places = self.landmarks
        held = torch.from_numpy(places).float().expand(*pose.rotations.shape[:2], -1, -1)
        return pose.heads(self.rig.body)[:, :, bones] + rotate(pose.rotations[:, :, bones], held)

    def base(self, windows: int, frames: int) -> BodyPose:
        """The rest pose at the origin, in every frame."""
        rest = self.rig.body.rest_world
        return BodyPose(torch.zeros(windows, frames, 3), rest.expand(windows, frames, *rest.shape))

    def draw(self, clean: BodyPose, valid: Tensor, rows: Sequence[np.random.Generator]) -> TaskBatch:
        if self.mirror is not None:
            clean = self.mirror.mirrored(clean, torch.tensor([row.random() < 0.5 for row in rows]))
        weight = valid.to(clean.roots.dtype)
        centre = (clean.roots * weight.unsqueeze(-1)).sum(1) / weight.sum(1, keepdim=True)
        points = self._points(clean, rows)
        made = [
            self._seen(points[row], centre[row].double().numpy(), valid[row].numpy(), rng)
            for row, rng in enumerate(rows)
        ]
        rays, trust, positions, known = (np.stack(part) for part in zip(*made, strict=True))
        seen = see_keypoints(rays, trust, known)
        turn = torch.from_numpy(view_yaw(positions, centre.double().numpy())).float()[:, None]
        roots = rotate(turn, clean.roots - centre[:, None])
        target = BodyPose(roots, multiply(turn[:, None], clean.rotations))
        given = seen.given & valid
        given[:, 0] |= ~given.any(1)
        return TaskBatch(seen.features, given, self.base(*valid.shape), target, valid)

    def _points(self, clean: BodyPose, rows: Sequence[np.random.Generator]) -> np.ndarray:
        """(B, T, K, 3) keypoints in the world, metres."""
        body = self.rig.body
        if self.corruption in OF_JOINTS:
            return clean.heads(body).double().numpy()
        bones, places = self.landmarks
        stretch = torch.from_numpy(np.stack([self._stretches(rng) for rng in rows])).float()
        moved = np.stack([rng.standard_normal(places.shape) for rng in rows]) * _MOVED_M
        offsets = body.offsets * stretch[:, body.parents.clip(0), None]
        # Per window: FK by the window's own offsets.
        heads = torch.stack(
            [
                pose_heads(_with_offsets(body, own), roots, turns)
                for own, roots, turns in zip(offsets, clean.roots, clean.rotations, strict=True)
            ]
        )
        held = torch.from_numpy(places + moved).float() * stretch[:, bones, None]
        found = heads[:, :, bones] + rotate(clean.rotations[:, :, bones], held[:, None])
        return found.double().numpy()

    def _stretches(self, rng: np.random.Generator) -> np.ndarray:
        """(J,) factors on the bones' lengths: one for the body, one for each body group, left and right alike."""
        limit = np.log(_MOST_STRETCHED)
        groups = self.rig.body.groups.numpy().clip(0)
        by_group = np.exp(rng.uniform(-limit / 2, limit / 2, 3))[[0, 1, 1, 2, 2]]
        return by_group[groups] * np.exp(rng.uniform(-limit / 2, limit / 2))

    def _seen(
        self, points: np.ndarray, centre: np.ndarray, valid: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """Rays (T, K, 2), confidences (T, K), the camera's position, and whether the camera is known."""
        paper = self.corruption in OF_JOINTS
        position = random_place(rng, centre, self.stature_m)
        target, roll = centre, 0.0
        if not paper:
            reach = _OFF_AXIS * float(np.linalg.norm(centre - position))
            target, roll = centre + rng.uniform(-reach, reach, 3) * (1, 0.6, 1), _ROLL_RAD * rng.standard_normal()
        rotation = multiply(look_at(position, target), np.array([0.0, 0.0, np.sin(roll / 2), np.cos(roll / 2)]))
        rays = projected(in_camera(points, position, np.broadcast_to(rotation, (*points.shape[:2], 4))))
        errors = DETECTOR if self.corruption == DETECTED else NONE
        rays, trust = (rays, np.ones(rays.shape[:2])) if paper else with_errors(rays, rng, errors)
        if self.corruption == MASKED:
            size = float(np.ptp(rays, axis=1).mean())
            rays = rays + _MOVED * size * rng.standard_normal(rays.shape)
            hidden = rng.random(rays.shape[1]) < _HIDDEN
            rays[:, hidden], trust[:, hidden] = np.nan, 0.0
        if not paper:
            lacking = ~landmark_mask(list(LAYOUTS)[int(rng.integers(len(LAYOUTS)))])
            rays[:, lacking], trust[:, lacking] = np.nan, 0.0
        rays[~valid], trust[~valid] = np.nan, 0.0
        return rays, trust, position, paper or bool(rng.random() < _KNOWN)

    @cached_property
    def stature_m(self) -> float:
        """About the rig's height: its rest pose from the lowest to the highest joint, and a head."""
        rest = pose_heads(self.rig.body, torch.zeros(3), self.rig.body.rest_world)
        return 1.1 * float(rest[:, 1].max() - rest[:, 1].min())

    def errors(self, made: BodyPose, batch: TaskBatch) -> dict[str, Tensor]:
        """Joint-wise L2 of positions from the root (metres), of quaternions and of the root's path; except for
        `paper`, also of the joints' velocities."""
        apart = self._apart(made, batch)
        turned = aligned_signs(made.rotations, batch.target.rotations) - batch.target.rotations
        path = (made.roots - batch.target.roots).unsqueeze(-2)
        found = {
            "position": mean_norm(apart, batch.valid),
            "quaternion": mean_norm(turned, batch.valid),
            "root": _ROOT_WEIGHT * mean_norm(path, batch.valid),
        }
        if self.corruption not in OF_JOINTS:  # a detector's jitter must not become the motion's
            found["velocity"] = _VELOCITY_WEIGHT * mean_norm(apart[:, 1:] - apart[:, :-1], batch.valid[:, 1:])
        return found

    def measures(self, made: BodyPose, batch: TaskBatch) -> dict[str, float]:
        """`mpjpe_mm` from the root, `mpjve_mm` a frame of the same, `root_mm` of the root's path."""
        apart = self._apart(made, batch)
        return {
            "mpjpe_mm": 1000 * float(mean_norm(apart, batch.valid)),
            "mpjve_mm": 1000 * float(mean_norm(apart[:, 1:] - apart[:, :-1], batch.valid[:, 1:])),
            "root_mm": 1000 * float(mean_norm((made.roots - batch.target.roots).unsqueeze(-2), batch.valid)),
        }

    def _apart(self, made: BodyPose, batch: TaskBatch) -> Tensor:
        """(B, T, J, 3) errors of positions from the root, metres."""
        body = self.rig.body
        return _rooted(made).heads(body) - _rooted(batch.target).heads(body)


def _rooted(pose: BodyPose) -> BodyPose:
    return BodyPose(torch.zeros_like(pose.roots), pose.rotations)


def _with_offsets(body: RigBody, offsets: Tensor) -> RigBody:
    return replace(body, offsets=offsets)
