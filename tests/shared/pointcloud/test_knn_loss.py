"""The temporally consistent KNN distance: a slow plain reference, its gradient, and what must not change it."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from stages.shared.pointcloud import knn_loss
from stages.shared.pointcloud.knn_loss import distances_of, nearest_trajectories, normalised_by_group, velocities


def clouds(seed: int = 0, batch: int = 2, frames: int = 5, source: int = 23, target: int = 31, dtype=torch.float64):
    """Two random clouds and their groups; every group has points on both sides."""
    generator = torch.Generator().manual_seed(seed)

    def draw(points: int) -> tuple[Tensor, Tensor]:
        groups = torch.randint(5, (batch, points), generator=generator)
        groups[:, :5] = torch.arange(5)
        return torch.randn(batch, frames, points, 3, generator=generator, dtype=dtype), groups

    (one, one_groups), (two, two_groups) = draw(source), draw(target)
    return one, two, one_groups, two_groups


def plain_loss(source, target, source_groups, target_groups, count, valid=None) -> float:
    """Eqs. 4 and 5 as loops, with the root mean square over time for a distance."""
    total, pairs = 0.0, 0
    for cloud in range(len(source)):
        keep = slice(None) if valid is None else valid[cloud]
        for point in range(source.shape[2]):
            apart = []
            for other in range(target.shape[2]):
                if source_groups[cloud, point] == target_groups[cloud, other]:
                    difference = source[cloud, keep, point] - target[cloud, keep, other]
                    apart.append(float(np.linalg.norm(difference) / np.sqrt(len(difference))))
            nearest = sorted(apart)[:count]
            total, pairs = total + sum(nearest), pairs + len(nearest)
    return total / pairs


@pytest.mark.parametrize("count", [1, 3, 8])
def test_it_is_the_plain_sum_over_loops(count):
    parts = clouds()
    expected = plain_loss(*(part.numpy() for part in parts), count)
    assert nearest_trajectories(*parts, count=count).mean().item() == pytest.approx(expected, rel=1e-9)


def test_frames_that_are_not_real_do_not_count():
    parts = clouds()
    valid = torch.tensor([[True] * 5, [True, True, True, False, False]])
    expected = plain_loss(*(part.numpy() for part in parts), 4, valid.numpy())
    assert nearest_trajectories(*parts, valid, 4).mean().item() == pytest.approx(expected, rel=1e-9)
    parts[0][1, 3:] = 1e3
    assert nearest_trajectories(*parts, valid, 4).mean().item() == pytest.approx(expected, rel=1e-9)


def test_a_group_that_the_target_lacks_or_has_few_points_of():
    source, target, one, two = clouds()
    two = torch.where(two == 2, 0, two)
    two[:, 0] = 2  # one point where eight are asked for
    near = nearest_trajectories(source, target, one, two)
    members = one == 2
    assert (near.real[members].sum(-1) == 1).all() and near.real[~members].sum(-1).min() > 1
    assert (near.index[members][:, 0] == 0).all()
    assert near.mean().item() == pytest.approx(plain_loss(*(p.numpy() for p in (source, target, one, two)), 8))
    near = nearest_trajectories(source, target, one, torch.where(two == 2, 1, two))
    assert not near.real[members].any() and torch.isfinite(near.mean())
    assert near.means().shape == (2,)


def test_chunks_change_nothing(monkeypatch):
    parts = clouds()
    whole = nearest_trajectories(*parts)
    monkeypatch.setattr(knn_loss, "_TABLE_NUMBERS", 300)
    cut = nearest_trajectories(*parts)
    torch.testing.assert_close(whole.distance, cut.distance)
    again = distances_of(*parts[:2], whole).distance
    torch.testing.assert_close(again[whole.real], whole.distance[whole.real])


def test_the_gradient_is_that_of_finite_differences():
    source, target, one, two = clouds(frames=3, source=9, target=11)
    valid = torch.tensor([[True, True, True], [True, True, False]])
    target.requires_grad_()
    source.requires_grad_()
    distance = lambda a, b: nearest_trajectories(a, b, one, two, valid, 3).mean()  # noqa: E731
    assert torch.autograd.gradcheck(distance, (source, target))
    assert torch.autograd.gradcheck(lambda a: normalised_by_group(a, one, valid).sin().sum(), (source,))


def test_points_that_meet_have_a_finite_gradient():
    source, _, groups, _ = clouds(dtype=torch.float32)
    target = source.clone().requires_grad_()
    loss = nearest_trajectories(source, target, groups, groups, count=1).mean()
    loss.backward()
    assert loss < 1e-3 and target.grad is not None and torch.isfinite(target.grad).all()


@pytest.mark.parametrize("change", ["points", "turn", "shift", "time"])
def test_what_does_not_change_it(change):
    source, target, one, two = clouds()
    before = nearest_trajectories(source, target, one, two).mean()
    if change == "points":
        order, other = torch.randperm(source.shape[2]), torch.randperm(target.shape[2])
        source, one, target, two = source[:, :, order], one[:, order], target[:, :, other], two[:, other]
    elif change == "turn":
        turn = torch.from_numpy(Rotation.random(random_state=0).as_matrix())
        source, target = source @ turn, target @ turn
    elif change == "shift":
        source, target = source + torch.tensor([10.0, -3, 7]), target + torch.tensor([10.0, -3, 7])
    else:
        source, target = source.flip(1), target.flip(1)
    torch.testing.assert_close(nearest_trajectories(source, target, one, two).mean(), before)


def test_neighbours_are_found_on_whole_trajectories():
    """A point that is nearest in one frame, and far in the others, is not a neighbour."""
    source = torch.zeros(1, 4, 1, 3)
    near_once, near_always = torch.full((4, 3), 5.0), torch.full((4, 3), 0.2)
    near_once[0] = 0
    target = torch.stack([near_once, near_always], dim=1).unsqueeze(0)
    near = nearest_trajectories(source, target, torch.zeros(1, 1), torch.zeros(1, 2), count=1)
    assert near.index.item() == 1
    assert near.distance.item() == pytest.approx(0.2 * 3**0.5, rel=1e-5)


def test_float32_is_precise_far_from_the_origin():
    source, target, one, two = clouds(frames=128)
    far = torch.tensor([40.0, 0, -25])
    exact = nearest_trajectories(source, target, one, two).distance
    near = nearest_trajectories((source + far).float(), (target + far).float(), one, two).distance
    assert (near - exact).abs().max() < 1e-5


def test_velocities_are_metres_a_second():
    times = torch.arange(6).view(1, 6, 1, 1) / 30
    points = times * torch.tensor([1.0, -2, 0.5]) + 3
    speed, real = velocities(points, torch.tensor([[True, True, True, True, False, False]]))
    torch.testing.assert_close(speed, torch.tensor([1.0, -2, 0.5]).expand(1, 5, 1, 3), atol=1e-4, rtol=1e-4)
    assert real is not None and real.tolist() == [[True, True, True, False, False]]


def test_a_limbs_place_and_size_are_normalised_away():
    points, _, groups, _ = clouds()
    moved = points.clone()
    arm = groups[0] == 1
    moved[0, :, arm] = points[0, :, arm] * 1.7 + torch.randn(5, 1, 3, dtype=points.dtype)
    shapes = normalised_by_group(points, groups), normalised_by_group(moved, groups)
    torch.testing.assert_close(*shapes, atol=1e-5, rtol=1e-5)
    for group in range(5):
        mine = shapes[0][1][:, groups[1] == group]
        torch.testing.assert_close(mine.mean(1), torch.zeros(5, 3, dtype=points.dtype), atol=1e-9, rtol=0)
        assert mine.square().sum(-1).mean().item() == pytest.approx(1, rel=1e-4)
