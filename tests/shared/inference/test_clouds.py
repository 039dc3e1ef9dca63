"""Clouds that are encoded: what comes of them hangs on the pose, and hardly on where the points fell."""

from pathlib import Path

import numpy as np
import pytest
import torch

import stages.shared.clips
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.inference.clouds import place_on_pose
from stages.shared.inference.decoded_clouds import views_of
from stages.shared.inference.models import load_weights
from stages.shared.pointcloud.drawn_points import DrawnPoints, draw_on_skeleton, spread_on_skeleton
from stages.shared.solve.skeleton_pose import pose_of_motion

CLIPS = Path(stages.shared.clips.__file__).parent


@pytest.mark.parametrize("clip", ["walk.bvh", "cartwheel.bvh"])
def test_an_even_spread_moves_latents_far_less_than_a_random_draw(clip):
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / clip).read_bytes(), clip))
    pose, models = pose_of_motion(skeleton, motion), load_weights("small-free")

    def apart(one: DrawnPoints, other: DrawnPoints) -> float:
        """How far two draws' latents are apart, as a share of how far the motion moves them, mean squares."""
        first, second = (models.encode(place_on_pose(each, pose, skeleton), each.groups)[0] for each in (one, other))
        return float((first - second).square().sum() / 2 / (first - first.mean(0)).square().sum())

    points, rng = models.autoencoder.points, np.random.default_rng(0)
    spread = apart(*(spread_on_skeleton(skeleton, points, start, 0.05) for start in (0.2, 0.7)))
    drawn = apart(*(draw_on_skeleton(skeleton, points, rng, 0.05) for _ in range(2)))
    assert spread < drawn / 4


def test_a_spread_lies_on_seen_bones_and_tells_their_groups():
    skeleton, _, _ = motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk.bvh"))
    spread = spread_on_skeleton(skeleton, 64, 0.5, 0.0)
    assert np.asarray(skeleton.sampled)[spread.bones.numpy()].all()
    assert (torch.as_tensor(skeleton.groups).long()[spread.bones] == spread.groups).all()
    tails = torch.as_tensor(skeleton.tails, dtype=torch.float32)[spread.bones]
    share = (spread.in_bone * tails).sum(-1) / tails.square().sum(-1)
    torch.testing.assert_close(spread.in_bone, share.unsqueeze(-1) * tails, atol=1e-6, rtol=1e-5)


class Echo:
    """A coder that keeps what it is shown and makes the same cloud again."""

    def encode(self, points, groups):
        self.points, self.seen_groups = points, groups
        return points.mean(1), points.mean(1)

    def decode(self, latents, centroids, times, groups, noise, spans=None):
        self.asked_groups = groups
        return self.points


@pytest.mark.parametrize("number", range(4))
def test_what_a_view_is_shown_comes_back_where_it_was(number):
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk.bvh"))
    pose, drawn = pose_of_motion(skeleton, motion), spread_on_skeleton(skeleton, 32, 0.5, 0.05)
    view, coder, there = views_of(4)[number], Echo(), place_on_pose(drawn, pose, skeleton)
    given = view.encode(coder, pose, drawn, skeleton)
    back = view.decode(coder, given, torch.arange(len(there)), drawn.groups, torch.zeros(32, 4))
    torch.testing.assert_close(back, there, atol=1e-5, rtol=1e-5)
    assert (coder.points[..., 1] == there[..., 1]).all()  # about the vertical alone
    assert (coder.seen_groups == coder.asked_groups).all()
    # Who walks on has the left side to the left of the way, mirrored or not: labels are exchanged with the sides.
    shown, groups = coder.points, coder.seen_groups
    up = torch.tensor([0.0, 1.0, 0.0])
    way = shown[-1].mean(0) - shown[0].mean(0)
    sides = (shown[:, groups == 3].mean(1) - shown[:, groups == 4].mean(1)).mean(0)
    assert float(torch.linalg.cross(up, way) @ sides) > 0
    assert view.mirrored == (number % 2 == 1)
    assert bool((groups != drawn.groups).any()) == view.mirrored
