"""Cameras: projection against a pinhole matrix, round trips, gradients, and the frames of cameras."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.kinematics.cameras import (
    DISTANCE_M,
    Intrinsics,
    in_camera,
    intrinsics_of_fov,
    level_camera,
    look_at,
    placed_around,
    projected,
    random_place,
    view_yaw,
)
from stages.shared.kinematics.rotations import rotate

_SEEDS = st.integers(0, 10**6)


@given(_SEEDS)
def test_projection_agrees_with_a_pinhole_matrix(seed: int):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=seed)
    position, points = rng.normal(size=3), rng.normal(size=(7, 3))
    camera = Intrinsics(rng.uniform(300, 2000), (320.0, 240.0))
    matrix = np.array([[camera.focal_px, 0, 320.0], [0, camera.focal_px, 240.0], [0, 0, 1]])
    inside = rotation.as_matrix().T @ (points - position).T
    front = inside[2] > 0.1
    flat = (matrix @ inside)[:, front]
    seen = camera.pixels(projected(in_camera(points, position, np.tile(rotation.as_quat(), (7, 1)))))
    np.testing.assert_allclose(seen[front], (flat[:2] / flat[2]).T, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(camera.pixels(camera.rays(seen)), seen, rtol=1e-9, atol=1e-9)


@given(_SEEDS)
def test_a_camera_that_looks_at_a_point_has_it_in_the_middle_and_is_level(seed: int):
    rng = np.random.default_rng(seed)
    target, middle = rng.normal(size=3), np.zeros(2)
    position = random_place(rng, target)
    rotation = look_at(position, target)
    np.testing.assert_allclose(projected(in_camera(target, position, rotation)), middle, atol=1e-9)
    right, down = rotate(np.tile(rotation, (2, 1)), np.eye(3)[:2])
    assert abs(right[1]) < 1e-9 and down[1] < 0
    assert DISTANCE_M[0] - 1e-9 <= np.linalg.norm(position - target) <= DISTANCE_M[1] + 1e-9


@given(_SEEDS)
def test_in_the_views_frame_the_camera_is_a_level_one(seed: int):
    """Turned by `view_yaw`, the camera of `look_at` is `level_camera` with its pitch."""
    rng = np.random.default_rng(seed)
    position = random_place(rng, np.zeros(3))
    pitch = np.arctan2(position[1], np.hypot(position[0], position[2]))
    turned = Rotation.from_quat(view_yaw(position, np.zeros(3))) * Rotation.from_quat(look_at(position, np.zeros(3)))
    level = Rotation.from_quat(level_camera(np.array(pitch), np.array(0.0)))
    assert (turned.inv() * level).magnitude() < 1e-6
    away = rotate(view_yaw(position, np.zeros(3)), position)
    assert away[2] > 0 and abs(away[0]) < 1e-9


def test_gradients_and_both_kinds_of_arrays():
    rng = np.random.default_rng(0)
    rotation = look_at(np.array([1.0, 2.0, 4.0]), np.zeros(3))
    points = rng.normal(size=(5, 3))
    position = np.array([1.0, 2.0, 4.0])
    inputs = (torch.tensor(points, requires_grad=True), torch.tensor(position, requires_grad=True))
    turn = torch.tensor(np.tile(rotation, (5, 1)))
    made = projected(in_camera(inputs[0], inputs[1], turn))
    np.testing.assert_allclose(made.detach().numpy(), projected(in_camera(points, position, turn.numpy())))
    assert torch.autograd.gradcheck(lambda p, c: projected(in_camera(p, c, turn)), inputs)
    pitch = torch.tensor(0.2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p: level_camera(p, torch.tensor(0.1, dtype=torch.float64)), (pitch,))


def test_a_point_behind_the_camera_has_finite_rays():
    seen = projected(torch.tensor([[0.1, 0.1, -1.0], [0.0, 0.0, 0.0]], requires_grad=True))
    assert torch.isfinite(seen).all()


@pytest.mark.parametrize(("azimuth", "side"), [(0, (0, 0, 1)), (90, (1, 0, 0)), (180, (0, 0, -1))])
def test_a_camera_is_placed_around(azimuth: float, side: tuple[float, float, float]):
    found = placed_around(np.array([1.0, 1.0, 1.0]), np.zeros(3), azimuth, 0.0, 3.0)
    np.testing.assert_allclose(found, 3 * np.array(side), atol=1e-9)
    kept = placed_around(np.array([1.0, 1.0, 1.0]), np.zeros(3), None, None, None)
    np.testing.assert_allclose(kept, [1, 1, 1], atol=1e-9)


def test_the_field_of_view_is_the_horizontal_one():
    camera = intrinsics_of_fov(90.0, (640.0, 480.0))
    assert camera.focal_px == pytest.approx(320) and camera.centre == (320, 240)
