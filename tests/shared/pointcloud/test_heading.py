"""Which way a cloud faces: it turns with the cloud, and is nothing else's affair."""

import math

import pytest
import roma
import torch

from stages.shared.pointcloud.heading import headings_of, turned, yaw_quaternions

GROUPS = torch.tensor([[0, 0, 1, 1, 2, 2, 3, 3, 4, 4]])


def figure(frames: int = 12) -> torch.Tensor:
    """A figure facing +Z: left limbs at +X."""
    side = torch.tensor([0, 0, 1, 1, -1, -1, 0.3, 0.3, -0.3, -0.3])
    points = torch.stack([side, torch.linspace(0, 1, 10), 0.1 * torch.sin(torch.arange(10.0))], dim=-1)
    return points.expand(1, frames, 10, 3)


@pytest.mark.parametrize("angle", [0.0, 1.0, 3.0, -2.5])
def test_a_turned_figure_is_turned_back(angle):
    points = figure()
    yaw = headings_of(turned(points, torch.tensor(angle)), GROUPS)
    base = headings_of(points, GROUPS)
    assert torch.allclose(torch.cos(yaw + angle - base), torch.ones_like(yaw), atol=1e-5)
    back = turned(turned(points, torch.tensor(angle)), yaw.unsqueeze(-1))
    torch.testing.assert_close(back, turned(points, base.unsqueeze(-1)), atol=1e-5, rtol=1e-5)


def test_the_quaternion_is_the_same_turn():
    vectors = torch.randn(5, 3, generator=torch.Generator().manual_seed(0))
    yaw = torch.linspace(-math.pi, math.pi, 5)
    torch.testing.assert_close(roma.quat_action(yaw_quaternions(yaw), vectors), turned(vectors, yaw))


def test_missing_limbs_and_frames_say_nothing():
    points = figure()
    armed = headings_of(points[:, :, :6], GROUPS[:, :6])
    torch.testing.assert_close(armed, headings_of(points, GROUPS), atol=0.1, rtol=0)
    assert torch.isfinite(headings_of(points[:, :, :2], GROUPS[:, :2])).all()
    valid = torch.ones(1, 12, dtype=torch.bool)
    valid[:, 8:] = False
    broken = points.clone()
    broken[:, 8:] = -50 * broken[:, 8:]
    torch.testing.assert_close(headings_of(broken, GROUPS, valid)[:, :8], headings_of(points, GROUPS)[:, :8])
