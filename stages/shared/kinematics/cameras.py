"""Perspective cameras: projection, cameras at random places that look at a body, and rays of image points.

A camera's axes are x to the right, y down and z forward (as OpenCV has them), the world's are those of
`stages.shared.kinematics.conventions`. Functions take NumPy arrays or torch tensors, and torch's have gradients.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from stages.shared.kinematics.rotations import conjugate, multiply, rotate

if TYPE_CHECKING:
    from torch import Tensor

Array = TypeVar("Array", np.ndarray, "Tensor")
LEAST_DEPTH_M = 0.05  # nearer points, and those behind the camera, are projected as if they were this far away
DEFAULT_FOV_DEG = 55.0  # horizontal, of a phone's main camera held upright or a webcam; of an unknown camera
DISTANCE_M = (2.0, 7.0)
ELEVATION_DEG = (-12.0, 40.0)  # of the camera, seen from the body
FOV_DEG = (25.0, 80.0)


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion. focal_px: focal length. centre: (2,) principal point, pixels."""

    focal_px: float
    centre: tuple[float, float]

    def rays(self, places: np.ndarray) -> np.ndarray:
        """Image points (..., 2) in pixels as x / z and y / z in the camera's axes."""
        return (places - np.array(self.centre)) / self.focal_px

    def pixels(self, rays: np.ndarray) -> np.ndarray:
        """The inverse of `rays`."""
        return rays * self.focal_px + np.array(self.centre)


def intrinsics_of_fov(fov_deg: float, size: tuple[float, float]) -> Intrinsics:
    """The camera of a horizontal field of view, its principal point in the middle of an image of (width, height)."""
    width, height = size
    return Intrinsics(float(width / 2 / np.tan(np.radians(fov_deg) / 2)), (width / 2, height / 2))


def in_camera(points: Array, position: Array, rotation: Array) -> Array:
    """World points (..., 3), metres, in the axes of cameras, which broadcast.

    Args:
        position: (..., 3) of the camera. rotation: (..., 4) xyzw, of the camera's axes in the world.
    """
    return rotate(conjugate(rotation), points - position)


def projected(points: Array) -> Array:
    """Rays (..., 2), x / z and y / z, of points (..., 3) in the camera's axes. Smooth in front of the camera."""
    xp = _module_of(points)
    depth = points[..., 2:]
    depth = xp.where(depth > LEAST_DEPTH_M, depth, xp.full_like(depth, LEAST_DEPTH_M))
    return points[..., :2] / depth


def look_at(position: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(..., 4) rotations of cameras without roll at `position` (..., 3) whose principal point is `target` (..., 3).

    The up of the image is along -Z for a camera straight above its target, and along +Z for one straight below.
    """
    from scipy.spatial.transform import Rotation

    forward = target - position
    forward = forward / np.maximum(np.linalg.norm(forward, axis=-1, keepdims=True), 1e-12)
    right = np.cross(forward, np.broadcast_to([0.0, 1.0, 0.0], forward.shape))
    flat = np.linalg.norm(right, axis=-1, keepdims=True) < 1e-9
    right = np.where(flat, [1.0, 0.0, 0.0], right)
    right = right / np.linalg.norm(right, axis=-1, keepdims=True)
    axes = np.stack([right, np.cross(forward, right), forward], axis=-1)
    return Rotation.from_matrix(axes.reshape(-1, 3, 3)).as_quat().reshape(*forward.shape[:-1], 4)


def random_place(rng: np.random.Generator, target: np.ndarray, body_m: float = 1.7) -> np.ndarray:
    """(3,) a random position of a camera around a target (3,): any side, `ELEVATION_DEG`, `DISTANCE_M` for a body of
    1.7 m, and in proportion for others."""
    azimuth = rng.uniform(0, 2 * np.pi)
    elevation = np.radians(rng.uniform(*ELEVATION_DEG))
    distance = np.exp(rng.uniform(*np.log(DISTANCE_M))) * body_m / 1.7
    return target + distance * _direction(azimuth, elevation)


def _direction(azimuth: float, elevation: float) -> np.ndarray:
    """(3,) unit vector of these angles, radians: 0 azimuth is +Z, a quarter turn +X."""
    level = np.cos(elevation)
    return np.array([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level])


def placed_around(
    position: np.ndarray,
    target: np.ndarray,
    azimuth_deg: float | None,
    elevation_deg: float | None,
    distance_m: float | None,
) -> np.ndarray:
    """(3,) a camera's position with some of its direction and distance from a target (3,) replaced."""
    away = position - target
    level = float(np.hypot(away[0], away[2]))
    azimuth = np.arctan2(away[0], away[2]) if azimuth_deg is None else np.radians(azimuth_deg)
    elevation = np.arctan2(away[1], level) if elevation_deg is None else np.radians(elevation_deg)
    distance = float(np.linalg.norm(away)) if distance_m is None else distance_m
    return target + distance * _direction(azimuth, elevation)


def camera_as_data(position: np.ndarray, rotation: np.ndarray, intrinsics: Intrinsics) -> dict[str, Any]:
    """A camera as plain data, for files and reports."""
    return {
        "position_m": position.tolist(),
        "rotation_xyzw": rotation.tolist(),
        "focal_px": intrinsics.focal_px,
        "centre_px": list(intrinsics.centre),
    }


def view_yaw(position: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(..., 4) rotations about Y from the world to the view's frame: level, the camera looks along -Z.

    In it a body that faces the camera faces +Z, wherever the camera stands.
    """
    away = position - target
    half = -np.arctan2(away[..., 0], away[..., 2]) / 2
    zero = np.zeros_like(half)
    return np.stack([zero, np.sin(half), zero, np.cos(half)], axis=-1)


def level_camera(pitch: Array, roll: Array) -> Array:
    """(..., 4) rotations of a camera at the origin of the view's frame that looks along -Z.

    Args: pitch: (...) radians, positive when the camera looks down. roll: (...) radians about its axis.
    """
    xp = _module_of(pitch)
    # Half a turn about X takes the camera's axes (x right, y down, z forward) to X right, Y up, looking along -Z.
    half, zero = pitch / 2, pitch * 0
    tilt = xp.stack([xp.cos(half), zero, zero, xp.sin(half)], -1)
    turn = xp.stack([zero, zero, xp.sin(roll / 2), xp.cos(roll / 2)], -1)
    return multiply(tilt, turn)


def _module_of(values: Any) -> Any:
    return np if isinstance(values, np.ndarray) else sys.modules["torch"]
