"""The camera and the path of a body whose pose is known, from where its points are seen in an image.

The pose is level (Y up), the camera stands still at the origin of the level frame and looks along -Z, apart from its
pitch and roll. For a given camera the body's path is a linear least-squares problem (direct linear transform); the
camera's few numbers are found around it by SciPy (variable projection).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded
from scipy.optimize import least_squares

from stages.shared.kinematics.cameras import level_camera, projected
from stages.shared.kinematics.rotations import conjugate, rotate

POSE_ERROR_M = 0.06  # standard deviation of a point of the pose
BEND_M = 0.004  # of the path's second difference at 30 frames a second
_PITCH_PRIOR, _ROLL_PRIOR, _ZOOM_PRIOR = np.radians(10.0), np.radians(2.0), 0.04
_CAMERA_EVIDENCE = 40.0  # all points count as at most so many, because the errors of a pose are alike over a clip
_ROBUST = 2.0  # standard deviations from which a point counts less
_ROUNDS = 5
_MOST_FRAMES = 80  # that the camera is found from
_NEAREST_M, _FARTHEST_M = 0.3, 100.0


@dataclass(frozen=True)
class SolvedView:
    """pitch, roll: radians, of the camera. zoom: factor on the assumed focal length, 1 if that is known.

    path: (T, 3) metres, of the body's origin in the level frame. error: (T,) root-mean-square distance of the seen
    points from the body's projected ones, metres at the body's distance; NaN in frames without points.
    """

    pitch: float
    roll: float
    zoom: float
    path: np.ndarray
    error: np.ndarray

    def rays(self, points: np.ndarray) -> np.ndarray:
        """Where points (..., 3) of the level frame are seen, as rays (..., 2) of the assumed camera."""
        turn = _turn(self.pitch, self.roll)
        return projected(rotate(np.broadcast_to(turn, (*points.shape[:-1], 4)), points)) * self.zoom


def solve_view(
    points: np.ndarray, rays: np.ndarray, trust: np.ndarray, *, fps: float = 30.0, known: bool = True
) -> SolvedView:
    """Find the camera and the path.

    Args:
        points: (T, K, 3) of the body, metres, from its origin, level.
        rays: (T, K, 2) where they are seen (`cameras.Intrinsics.rays`), NaN where missing.
        trust: (T, K) confidences, 0 where missing; at least one frame must have three.
        known: False if the focal length is assumed, and may be wrong.
    """
    trust = np.where(np.isfinite(rays).all(axis=-1), trust, 0.0)
    rays = np.where(trust[..., None] > 0, rays, 0.0)
    enough = np.flatnonzero((trust > 0).sum(axis=1) >= 3)
    some = enough[np.unique(np.linspace(0, len(enough) - 1, _MOST_FRAMES).round().astype(int))]

    straight, _ = _through(points[some], rays[some], np.zeros(2))
    depth = _paths_alone(straight, rays[some], trust[some])[:, 2]

    def residuals(camera: np.ndarray) -> np.ndarray:
        turned, zoomed = _through(points[some], rays[some], camera)
        path = _paths_alone(turned, zoomed, trust[some])
        # At one depth for all cameras: else the nearest path would have the least error.
        apart = _apart(turned, zoomed, path, depth) * np.sqrt(trust[some])[..., None] / POSE_ERROR_M
        # The priors weigh as much beside a long clip as beside a short one: errors of frames are not independent.
        scale = np.sqrt(_CAMERA_EVIDENCE / max(_CAMERA_EVIDENCE, float(trust[some].sum())))
        prior = camera / np.array([_PITCH_PRIOR, _ROLL_PRIOR, _ZOOM_PRIOR])[: len(camera)]
        return np.concatenate([scale * apart.ravel(), prior])

    start = np.zeros(2 if known else 3)
    found = least_squares(residuals, start, loss="soft_l1", f_scale=_ROBUST, max_nfev=40, x_scale=0.1)
    camera = found.x
    turned, zoomed = _through(points, rays, camera)
    path = smooth_path(turned, zoomed, trust, fps)
    error = _frame_errors(turned, zoomed, path, trust)
    back = conjugate(_turn(camera[0], camera[1]))
    level = rotate(np.broadcast_to(back, (len(path), 4)), path)
    zoom = float(np.exp(camera[2])) if len(camera) > 2 else 1.0
    return SolvedView(float(camera[0]), float(camera[1]), zoom, level, error)


def _turn(pitch: float, roll: float) -> np.ndarray:
    """(4,) rotation from the level frame to the camera's axes."""
    return conjugate(level_camera(np.array(pitch), np.array(roll)))


def _through(points: np.ndarray, rays: np.ndarray, camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points in the camera's axes, and the rays of the zoomed camera."""
    turn = np.broadcast_to(_turn(camera[0], camera[1]), (*points.shape[:-1], 4))
    return rotate(turn, points), rays * (np.exp(-camera[2]) if len(camera) > 2 else 1.0)


def _equations(points: np.ndarray, rays: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations (T, 3, 3) and (T, 3) of the shift d with (p + d)_xy = ray (p + d)_z, weighted."""
    ones, zeros = np.ones(rays.shape[:2]), np.zeros(rays.shape[:2])
    rows = np.stack(
        [np.stack([ones, zeros, -rays[..., 0]], axis=-1), np.stack([zeros, ones, -rays[..., 1]], axis=-1)], axis=-2
    )  # (T, K, 2, 3)
    right = rays * points[..., 2:] - points[..., :2]
    weighted = rows * weights[..., None, None]
    return np.einsum("tkci,tkcj->tij", weighted, rows), np.einsum("tkci,tkc->ti", weighted, right)


def _paths_alone(points: np.ndarray, rays: np.ndarray, trust: np.ndarray) -> np.ndarray:
    """(T, 3) shifts of each frame by itself; points that lie far off count less."""
    weights = trust
    path = np.zeros((len(points), 3))
    for _ in range(_ROUNDS):
        left, right = _equations(points, rays, weights)
        path = np.linalg.solve(left + 1e-9 * np.eye(3), right[..., None])[..., 0]
        path[:, 2] = np.clip(path[:, 2], _NEAREST_M, _FARTHEST_M)
        weights = trust * _robust(points, rays, path, trust)
    return path


def _robust(points: np.ndarray, rays: np.ndarray, path: np.ndarray, trust: np.ndarray) -> np.ndarray:
    """(T, K) weights: 1 for points near to where they are projected, falling with the square of the distance in units
    of the frame's own errors."""
    apart = np.linalg.norm(_apart(points, rays, path), axis=-1)
    ordered = np.sort(np.where(trust > 0, apart, np.inf), axis=1)
    middle = np.maximum((trust > 0).sum(axis=1) - 1, 0) // 2
    usual = np.take_along_axis(ordered, middle[:, None], axis=1)
    scale = np.maximum(_ROBUST * POSE_ERROR_M, 1.5 * np.where(np.isfinite(usual), usual, 0.0))
    return 1 / (1 + (apart / scale) ** 2)


def _apart(points: np.ndarray, rays: np.ndarray, path: np.ndarray, depth: np.ndarray | None = None) -> np.ndarray:
    """(T, K, 2) metres at a depth (T,), the body's own by default, from where points are seen to where they are
    projected."""
    depth = np.maximum(path[:, 2], _NEAREST_M) if depth is None else depth
    return (projected(points + path[:, None]) - rays) * depth[:, None, None]


def smooth_path(points: np.ndarray, rays: np.ndarray, trust: np.ndarray, fps: float) -> np.ndarray:
    """(T, 3) the path in the camera's axes that bends little and projects the points to where they are seen.

    A banded linear system, solved a few times with points that lie far off counting less; frames without points get
    the path between the others. Time and memory are linear in T.
    """
    path = _paths_alone(points, rays, trust)
    bend = 1.0 / (BEND_M * (30.0 / fps) ** 2) ** 2
    for _ in range(_ROUNDS):
        # A point's error at the body's distance is the equation's own, whose unit is metres.
        weights = trust * _robust(points, rays, path, trust)
        left, right = _equations(points, rays, weights / POSE_ERROR_M**2)
        path = _solved(left, right, bend)
        path[:, 2] = np.clip(path[:, 2], _NEAREST_M, _FARTHEST_M)
    return path


def _solved(left: np.ndarray, right: np.ndarray, bend: float) -> np.ndarray:
    """(T, 3) solution of the frames' equations plus `bend` times the squared second differences."""
    frames = len(left)
    size, width = 3 * frames, 7
    bands = np.zeros((width, size))  # bands[width - 1 - k, j] is the entry (j - k, j)
    for row in range(3):
        for column in range(row, 3):
            bands[width - 1 - (column - row), column::3] += left[:, row, column]
    bands[-1] += 1e-6
    if frames > 2:
        stencil = np.array([1.0, -2.0, 1.0])
        for first in range(3):
            for second in range(first, 3):
                product = bend * stencil[first] * stencil[second]
                at = 3 * np.arange(second, second + frames - 2)
                for axis in range(3):
                    bands[width - 1 - 3 * (second - first), at + axis] += product
    return solveh_banded(bands, right.reshape(-1)).reshape(frames, 3)


def _frame_errors(points: np.ndarray, rays: np.ndarray, path: np.ndarray, trust: np.ndarray) -> np.ndarray:
    there = trust > 0
    squares = np.where(there, (_apart(points, rays, path) ** 2).sum(-1), 0.0).sum(1)
    count = there.sum(1)
    return np.where(count > 0, np.sqrt(squares / np.maximum(count, 1)), np.nan)
