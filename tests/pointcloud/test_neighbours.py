"""Farthest points and nearest neighbours against slow plain references."""

import numpy as np
import pytest
import torch

from stages.pointcloud.neighbours import farthest_points, nearest_points, take


def plain_farthest(points: np.ndarray, count: int) -> list[int]:
    chosen = [int(((points - points.mean(0)) ** 2).sum(-1).argmax())]
    while len(chosen) < count:
        apart = np.min([((points - points[index]) ** 2).sum(-1) for index in chosen], axis=0)
        chosen.append(int(apart.argmax()))
    return chosen


@pytest.mark.parametrize(("points", "count"), [(30, 8), (9, 9), (5, 1)])
def test_farthest_points_agree_with_the_plain_traversal(points, count):
    clouds = torch.randn(6, points, 3, generator=torch.Generator().manual_seed(points))
    found = farthest_points(clouds, count)
    for cloud, chosen in zip(clouds.numpy(), found.tolist(), strict=True):
        assert chosen == plain_farthest(cloud, count)


def test_farthest_points_do_not_depend_on_the_order_of_points():
    cloud = torch.randn(1, 40, 3, generator=torch.Generator().manual_seed(1))
    order = torch.randperm(40, generator=torch.Generator().manual_seed(2))
    first = take(cloud, farthest_points(cloud, 10))
    second = take(cloud[:, order], farthest_points(cloud[:, order], 10))
    torch.testing.assert_close(first, second)


def test_nearest_points_are_the_nearest_and_hold_the_point_itself():
    cloud = torch.randn(3, 25, 3, generator=torch.Generator().manual_seed(4))
    found = nearest_points(cloud, cloud, 8).sort(-1).values
    expected = torch.cdist(cloud, cloud).argsort(-1)[..., :8].sort(-1).values
    assert (found == expected).all()
    assert (found == torch.arange(25).view(1, 25, 1)).any(-1).all()


def test_fewer_points_than_neighbours_are_all_taken():
    cloud = torch.randn(2, 5, 3)
    assert nearest_points(cloud, cloud, 8).shape == (2, 5, 5)
