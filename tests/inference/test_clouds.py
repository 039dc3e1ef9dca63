"""Clouds that are encoded: what comes of them hangs on the pose, and hardly on where the points fell."""

from pathlib import Path

import numpy as np
import pytest
import torch

import stages.clips
from stages.formats.bvh import read_bvh
from stages.formats.bvh_motion import motion_of
from stages.inference.clouds import DrawnPoints, draw_on_skeleton, place_on_pose, spread_on_skeleton
from stages.inference.local_pose import pose_of_motion
from stages.inference.models import load_weights

CLIPS = Path(stages.clips.__file__).parent


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
