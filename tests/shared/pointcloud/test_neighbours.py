"""Farthest points and nearest neighbours against slow plain references."""

import numpy as np
import pytest
import torch

from stages.shared.pointcloud.neighbours import (
    _nearest_columns,
    farthest_points,
    nearest_points,
    pooling_levels,
    squared_distances,
    take,
)


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


@pytest.mark.parametrize(("points", "count"), [(50, 6), (17, 8), (4, 8), (1, 3)])
def test_pooling_levels_are_plain_searches_level_by_level(points, count):
    clouds = torch.randn(19, points, 3, generator=torch.Generator().manual_seed(points))
    levels = pooling_levels(clouds, 3, count)
    assert len(levels) == 3
    for level, found in enumerate(levels):
        apart = torch.cdist(clouds.double(), clouds.double()).numpy()
        wanted = np.sort(np.argsort(apart, axis=-1)[..., :count], axis=-1)
        np.testing.assert_array_equal(found.neighbours.sort(-1).values.numpy(), wanted)
        if level == 2:
            assert found.centres is None
            break
        assert found.centres is not None
        for cloud, chosen in zip(clouds.numpy(), found.centres.tolist(), strict=True):
            assert chosen == plain_farthest(cloud, -(-len(cloud) // 4))
        clouds = take(clouds, found.centres)


def test_threads_change_no_level():
    clouds, before = torch.randn(40, 30, 3), torch.get_num_threads()
    found = []
    for threads in (1, 3):
        torch.set_num_threads(threads)
        try:
            found.append(pooling_levels(clouds, 2, 5))
        finally:
            torch.set_num_threads(before)
    torch.testing.assert_close(found[0][0].neighbours, found[1][0].neighbours)
    torch.testing.assert_close(found[0][0].centres, found[1][0].centres)


def test_points_in_one_place_have_as_many_neighbours_as_others():
    cloud = torch.zeros(1, 9, 3)
    cloud[0, 4:] = torch.randn(5, 3)
    for found in (pooling_levels(cloud, 1, 4)[0].neighbours, nearest_points(cloud, cloud, 4)):
        assert all(len(set(row)) == 4 for row in found[0].tolist())


def test_squared_distances_are_those_of_differences():
    first, second = torch.randn(2, 7, 3), torch.randn(2, 5, 3)
    expected = (first.unsqueeze(2) - second.unsqueeze(1)).square().sum(-1)
    torch.testing.assert_close(squared_distances(first, second), expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("step", [1e-9, 1e-6, 1e-3])
def test_neighbours_are_told_apart_by_the_last_bit_of_their_distance(step):
    """Values that differ in bits where the search keeps columns: the smallest, and the first of equal ones."""
    generator = np.random.default_rng(0)
    apart = (0.5 * (1 + step * generator.integers(0, 40, (3, 50, 50)))).astype(np.float32)
    apart[0, 0] = 0.0
    found = np.sort(_nearest_columns(apart, 6), axis=-1)
    np.testing.assert_array_equal(found, np.sort(np.argsort(apart, axis=-1, kind="stable")[..., :6], axis=-1))
