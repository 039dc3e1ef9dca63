"""Rigs out of real recordings: they rest upright, facing one way, and a motion comes back from its body alone."""

from pathlib import Path

import numpy as np
import pytest
import torch

from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.formats.sources import find_sources
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.rig import pose_heads

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.mark.real
@pytest.mark.parametrize("archive", ["cmu-dance.zip", "bandai-namco-1.zip", "lafan1-g1.zip"])
def test_real_rigs_stand_and_carry_their_own_motion(archive):
    if not (DATA / archive).exists():
        pytest.skip("no real motion capture beside the checkout")
    source = find_sources((str(DATA / archive),))[0]
    rig = rig_of_file(source.name)
    body = rig.body
    heads = pose_heads(body, torch.zeros(3), body.rest_world).numpy()
    groups = body.groups.numpy()
    legs, spine = heads[groups >= 3], heads[groups == 0]
    assert legs[:, 1].min() < -0.5 and spine[:, 1].max() > 0.25
    left, right = heads[groups == 3].mean(0), heads[groups == 4].mean(0)
    assert left[0] > right[0] + 0.05 and abs(left[2] - right[2]) < abs(left[0] - right[0])
    skeleton, motion, _ = motion_of(read_bvh(source.read(), source.name).select(np.arange(60)))
    joints = body.joints
    true = positions_of(skeleton, motion)
    made = rig.motion(
        torch.from_numpy(true[:, skeleton.root]), torch.from_numpy(motion.rotations[:, joints]), motion.fps
    )
    # Bandai Namco's joints move a little in their parents' frames, which a rig's do not.
    assert np.abs(positions_of(rig.skeleton, made)[:, joints] - true[:, joints]).max() < 0.02
