"""The pairing of points: optimal, one to one, never across body groups."""

from itertools import permutations

import numpy as np
import pytest
import torch
from scipy.optimize import linear_sum_assignment

from stages.shared.pointcloud.assignment import assign, chamfer_squared, paired_difference, trajectory_costs


def clouds(seed: int, points: int = 20) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    groups = torch.randint(0, 5, (2, points), generator=generator)
    return (
        torch.randn(2, 6, points, 3, generator=generator),
        torch.randn(2, 6, points, 3, generator=generator),
        groups,
    )


def test_costs_are_the_summed_squared_distances_of_real_frames():
    one, two, _ = clouds(0)
    valid = torch.ones(2, 6, dtype=torch.bool)
    valid[1, 4:] = False
    costs = trajectory_costs(one, two, valid)
    expected = (one[1, :4, 3] - two[1, :4, 7]).square().sum()
    torch.testing.assert_close(costs[1, 3, 7], expected, rtol=1e-4, atol=1e-4)


def test_pairs_stay_in_their_body_group_and_are_one_to_one():
    one, two, groups = clouds(1)
    pairs = assign(trajectory_costs(one, two), groups)
    assert (groups.gather(1, pairs) == groups).all()
    assert (pairs.sort(1).values == torch.arange(20)).all()


def test_no_other_pairing_is_cheaper():
    one, two, _ = clouds(2, points=6)
    groups = torch.zeros(2, 6, dtype=torch.long)
    costs = trajectory_costs(one, two)
    pairs = assign(costs, groups)
    for cloud in range(2):
        found = sum(costs[cloud, row, column] for row, column in enumerate(pairs[cloud].tolist()))
        best = min(
            sum(costs[cloud, row, column] for row, column in enumerate(order)) for order in permutations(range(6))
        )
        torch.testing.assert_close(found, best)


def test_a_shuffled_cloud_is_paired_with_itself():
    one, _, _ = clouds(3)
    groups = torch.zeros(2, 20, dtype=torch.long)
    order = torch.randperm(20, generator=torch.Generator().manual_seed(0))
    assert paired_difference(one[:, :, order], one, groups).abs().max() < 1e-6
    assert chamfer_squared(one[:, :, order], one, groups) < 1e-4


def test_a_group_with_no_point_or_one_point_costs_nothing_but_itself():
    one, two, _ = clouds(4)
    groups = torch.ones(2, 20, dtype=torch.long)
    groups[:, 0] = 4
    assert (assign(trajectory_costs(one, two), groups)[:, 0] == 0).all()
    assert torch.isfinite(chamfer_squared(one, two, groups))


@pytest.mark.parametrize("threads", [1, 3])
def test_the_cost_is_the_least_of_all_pairings_that_stay_in_their_group(threads):
    """SciPy on whole tables, where pairs across groups are forbidden by their cost, finds nothing cheaper."""
    generator = torch.Generator().manual_seed(5)
    costs = torch.rand(7, 40, 40, generator=generator)
    groups = torch.randint(0, 5, (7, 40), generator=generator)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        pairs = assign(costs, groups)
    finally:
        torch.set_num_threads(before)
    for table, group, chosen in zip(costs.numpy(), groups.numpy(), pairs.numpy(), strict=True):
        forbidden = np.where(group[:, None] == group[None], table.astype(np.float64), 1e6)
        rows, columns = linear_sum_assignment(forbidden)
        assert forbidden[np.arange(40), chosen].sum() == pytest.approx(forbidden[rows, columns].sum())
