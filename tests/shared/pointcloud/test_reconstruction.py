"""Distances of a reconstruction: nothing where clouds are equal, and the right share of each kind of difference."""

import numpy as np
import pytest
import torch

from stages.shared.pointcloud.assignment import chamfer_squared, paired_difference
from stages.shared.pointcloud.reconstruction import (
    chamfer_distance,
    distances,
    jerk,
    nearest_differences,
    spread_ratios,
)


@pytest.fixture
def cloud() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    points = torch.randn(2, 9, 20, 3, generator=generator)
    return points, torch.arange(5).repeat_interleave(4).expand(2, -1)


def test_equal_clouds_are_no_distance_apart_in_any_order_of_points(cloud):
    points, groups = cloud
    shuffled = points.clone()
    shuffled[:, :, :4] = points[:, :, [2, 0, 3, 1]]
    for figure in distances(paired_difference(shuffled, points, groups)):
        torch.testing.assert_close(figure, torch.zeros(2), atol=1e-6, rtol=0)
    torch.testing.assert_close(chamfer_distance(shuffled, points, groups), torch.zeros(2), atol=2e-3, rtol=0)


def test_a_constant_shift_is_distance_but_not_variation(cloud):
    points, _ = cloud
    whole, moving, square = distances((points + torch.tensor([0.03, 0.0, 0.04])) - points)
    torch.testing.assert_close(whole, torch.full((2,), 0.05), atol=1e-5, rtol=0)
    torch.testing.assert_close(square, torch.full((2,), 0.0025), atol=1e-5, rtol=0)
    assert float(moving.max()) < 1e-5


def test_padding_frames_count_for_nothing():
    apart = torch.ones(1, 4, 3, 3)
    apart[:, 2:] = 100
    valid = torch.tensor([[True, True, False, False]])
    for figure, expected in zip(distances(apart, valid), (3**0.5, 0.0, 3.0), strict=True):
        torch.testing.assert_close(figure, torch.tensor([expected]), atol=1e-5, rtol=1e-5)


def test_spread_is_the_ratio_of_sizes_by_group(cloud):
    points, groups = cloud
    made = points.clone()
    for group, size in enumerate((0.5, 1.0, 2.0, 0.0, 1.0)):
        middle = points[:, :, groups[0] == group].mean(2, keepdim=True)
        made[:, :, groups[0] == group] = middle + size * (points[:, :, groups[0] == group] - middle)
    expected = torch.tensor([0.5, 1.0, 2.0, 0.0, 1.0]).expand(2, -1)
    torch.testing.assert_close(spread_ratios(made, points, groups), expected, atol=1e-5, rtol=1e-5)


def test_a_group_of_one_point_has_no_spread(cloud):
    points, groups = cloud
    groups = groups.clone()
    groups[:, :3] = 1
    ratios = spread_ratios(points, points, groups)
    assert torch.isnan(ratios[:, 0]).all() and torch.isfinite(ratios[:, 1:]).all()


def test_nearest_pairs_are_those_of_the_chamfer_objective(cloud):
    points, groups = cloud
    made = points.flip(2) + 0.1
    valid = torch.ones(2, 9, dtype=torch.bool)
    valid[1, 5:] = False
    keep = valid[..., None, None]
    apart = nearest_differences(made, points, groups.flip(1), valid) * keep
    mean = (apart.square().sum((1, 3)) / valid.sum(1, keepdim=True)).mean()
    torch.testing.assert_close(mean, chamfer_squared(made, points, groups.flip(1), valid))


def test_nearest_pairs_against_a_plain_loop(cloud):
    points, groups = cloud
    made, kinds = (points * 0.7).numpy(), groups.numpy()
    true, found = points.numpy(), []
    for batch in range(2):
        for near, far in ((made, true), (true, made)):
            for point in range(20):
                others = [
                    np.sqrt(np.square(near[batch, :, point] - far[batch, :, other]).sum(-1).mean())
                    for other in range(20)
                    if kinds[batch, other] == kinds[batch, point]
                ]
                found.append(min(others))
    expected = torch.tensor(np.array(found).reshape(2, -1).mean(1), dtype=torch.float32)
    torch.testing.assert_close(chamfer_distance(points * 0.7, points, groups), expected, atol=1e-4, rtol=1e-4)


def test_jerk_of_a_cubic_is_its_third_derivative():
    times = torch.arange(12, dtype=torch.float64) / 30
    points = torch.zeros(1, 12, 1, 3, dtype=torch.float64)
    points[0, :, 0, 1] = 2 * times**3 - times**2 + 5
    torch.testing.assert_close(jerk(points, 30.0), torch.tensor([12.0], dtype=torch.float64), atol=1e-6, rtol=1e-6)
