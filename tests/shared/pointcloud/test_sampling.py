"""Drawing points on bones and placing them, against the equation written out."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.pointcloud.sampling import draw_points, place_points, points_in_bone, spread_points


def test_points_are_drawn_in_proportion_to_the_weights_and_never_on_unseen_bones():
    bones, alphas, offsets = draw_points(np.array([1.0, 0.0, 3.0]), 20000, np.random.default_rng(0))
    share = np.bincount(bones, minlength=3) / len(bones)
    assert share[1] == 0
    assert abs(share[2] - 0.75) < 0.015
    assert alphas.min() >= 0 and alphas.max() <= 1
    assert abs(offsets.std() - 1) < 0.02


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_point_is_where_equation_3_puts_it(seed):
    rng = np.random.default_rng(seed)
    heads = rng.normal(size=(4, 3, 3)).astype(np.float32)
    rotations = Rotation.random(12, random_state=seed % 2**32).as_quat().reshape(4, 3, 4).astype(np.float32)
    tails = rng.normal(size=(3, 3)).astype(np.float32)
    bones, alphas, offsets = draw_points(np.ones(3), 7, rng)
    local = points_in_bone(*(torch.from_numpy(part) for part in (tails, bones, alphas, offsets)), 0.05)
    placed = place_points(
        torch.from_numpy(heads), torch.from_numpy(rotations), torch.from_numpy(bones), local
    ).numpy()
    for frame in range(4):
        for point in range(7):
            bone = bones[point]
            inside = alphas[point] * tails[bone] + 0.05 * offsets[point]
            expected = heads[frame, bone] + Rotation.from_quat(rotations[frame, bone]).apply(inside)
            np.testing.assert_allclose(placed[frame, point], expected, atol=1e-5)


def test_a_cloud_moves_with_its_motion_and_keeps_its_points_apart():
    rng = np.random.default_rng(3)
    heads = torch.randn(5, 2, 3)
    rotations = torch.nn.functional.normalize(torch.randn(5, 2, 4), dim=-1)
    bones = torch.from_numpy(draw_points(np.array([1.0, 1.0]), 16, rng)[0])
    local = torch.randn(16, 3) * 0.1
    shift = torch.tensor([1.0, -2.0, 0.5])
    placed = place_points(heads, rotations, bones, local)
    torch.testing.assert_close(place_points(heads + shift, rotations, bones, local), placed + shift)
    same = bones == 0
    first = torch.cdist(placed[0, same], placed[0, same])
    torch.testing.assert_close(torch.cdist(placed[4, same], placed[4, same]), first, atol=1e-4, rtol=1e-4)


@settings(max_examples=50, deadline=None)
@given(
    weights=st.lists(st.sampled_from([0.0, 0.1, 0.5, 1.0, 3.0]), min_size=1, max_size=9).filter(any),
    start=st.floats(0, 1, exclude_max=True),
    points=st.integers(1, 70),
)
def test_points_spread_evenly_hold_each_bones_share_to_within_one(weights, start, points):
    shares = torch.tensor(weights)
    bones, alphas, offsets = spread_points(shares, points, torch.tensor(start))
    count = torch.bincount(bones, minlength=len(weights))
    assert (count[shares == 0] == 0).all()
    assert (count - points * shares / shares.sum()).abs().max() <= 1 + 1e-4
    assert alphas.min() >= 0 and alphas.max() <= 1 and torch.isfinite(offsets).all()
    place = shares.cumsum(0)[bones] - shares[bones] + alphas * shares[bones]  # along the bones laid end to end
    gaps = place.diff()
    assert points == 1 or torch.allclose(gaps, (shares.sum() / points).expand_as(gaps), atol=1e-4)


def test_points_spread_evenly_are_distributed_as_drawn_ones():
    """Over all starts, places are uniform, and offsets of one cloud are as a normal distribution's."""
    weights = torch.tensor([1.0, 0.0, 3.0]).expand(400, 3)
    bones, alphas, offsets = spread_points(weights, 16, torch.arange(400) / 400)
    assert torch.histc(alphas[bones == 2], 10, 0, 1).min() > 0.095 * (bones == 2).sum()
    many = spread_points(weights[0], 256, torch.tensor(0.5))[2]
    assert many.mean(0).abs().max() < 0.02 and (many.std(0) - 1).abs().max() < 0.05
    assert (torch.corrcoef(many.T) - torch.eye(3)).abs().max() < 0.05
    one = [spread_points(weights[0], 16, torch.tensor(start)) for start in (0.0, 0.25)]
    for row, (own, alpha, offset) in zip((0, 100), one, strict=True):
        assert (bones[row] == own).all() and (alphas[row] == alpha).all() and (offsets[row] == offset).all()
