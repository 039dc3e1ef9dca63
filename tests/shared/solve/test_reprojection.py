"""The camera and path of a known pose: exact where the pose is, linear in time, robust to points that are far off."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from stages.shared.kinematics.cameras import level_camera, projected
from stages.shared.kinematics.rotations import conjugate, rotate
from stages.shared.solve.reprojection import BEND_M, POSE_ERROR_M, smooth_path, solve_view


def _scene(pitch: float, roll: float, frames: int = 40):
    """Points of a body of 1.7 m, its path 4 m in front of the camera, and its rays."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (frames, 15, 3)) * [0.4, 0.85, 0.3]
    times = np.linspace(0, 1, frames)[:, None]
    path = np.array([-0.5, -0.3, -4.0]) + times * [1.0, 0.0, 0.6]
    turn = conjugate(level_camera(np.array(pitch), np.array(roll)))
    rays = projected(rotate(np.tile(turn, (frames, 15, 1)), points + path[:, None]))
    return points, path, rays


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.15, 0.02), (-0.1, 0.0)])
def test_the_camera_and_the_path_are_found(pitch: float, roll: float):
    points, path, rays = _scene(pitch, roll)
    found = solve_view(points, rays, np.ones(rays.shape[:2]))
    assert abs(found.pitch - pitch) < 0.02 and abs(found.roll - roll) < 0.02 and found.zoom == 1
    assert np.abs(found.path - path).max() < 0.12
    assert np.nanmax(found.error) < 0.03
    np.testing.assert_allclose(found.rays(points + found.path[:, None]), rays, atol=0.01)


@pytest.mark.parametrize("true", [1.25, 0.8])
def test_an_assumed_focal_length_moves_towards_the_true_one(true: float):
    points, _, rays = _scene(0.1, 0.0)
    found = solve_view(points, true * rays, np.ones(rays.shape[:2]), known=False)
    assert 0 < np.log(found.zoom) / np.log(true) < 1


def test_frames_without_points_get_the_path_between():
    points, path, rays = _scene(0.0, 0.0)
    trust = np.ones(rays.shape[:2])
    trust[10:20] = 0
    rays[10:20] = np.nan
    found = solve_view(points, rays, trust)
    assert np.isnan(found.error[12]) and np.isfinite(found.path).all()
    assert np.abs(found.path[10:20] - path[10:20]).max() < 0.12


def test_a_point_that_is_far_off_counts_less():
    points, path, rays = _scene(0.0, 0.0)
    rays[:, 0] += 0.5
    found = solve_view(points, rays, np.ones(rays.shape[:2]))
    assert np.abs(found.path - path).max() < 0.25


def test_the_banded_solution_is_that_of_the_plain_least_squares():
    """Beside a slow reference: the same cost, written out, minimised by SciPy."""
    points, _, rays = _scene(0.0, 0.0, frames=6)
    turn = conjugate(level_camera(np.array(0.0), np.array(0.0)))
    seen = rotate(np.tile(turn, (*points.shape[:2], 1)), points)
    rays = rays + 0.001 * np.random.default_rng(0).normal(size=rays.shape)  # so near that no point counts less

    def cost(flat: np.ndarray) -> np.ndarray:
        path = flat.reshape(-1, 3)
        moved = seen + path[:, None]
        data = (moved[..., :2] - rays * moved[..., 2:]) / POSE_ERROR_M
        bend = (path[2:] - 2 * path[1:-1] + path[:-2]) / BEND_M
        return np.concatenate([data.ravel(), bend.ravel()])

    reference = least_squares(cost, np.tile([0.0, 0.0, 4.0], (6, 1)).ravel()).x.reshape(-1, 3)
    found = smooth_path(seen, rays, np.ones(rays.shape[:2]), 30.0)
    np.testing.assert_allclose(found, reference, atol=2e-3)
