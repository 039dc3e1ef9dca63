"""A rig: its rest pose, posing its body, and motions of the whole skeleton."""

import json

import numpy as np
import pytest
import roma
import torch

from data_schemas.errors import InputError
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.heading import turned, yaw_quaternions
from stages.shared.pointcloud.rig import Rig, mean_rotations, pose_heads, rig_of_motion
from tests.shared.inference.examples import humanoid, swinging


@pytest.mark.parametrize("above", [False, True])
def test_a_motion_of_the_body_comes_back(above):
    skeleton = humanoid(above=above)
    motion = swinging(skeleton, 20)
    rig = rig_of_motion(skeleton, motion)
    heads = positions_of(skeleton, motion)
    joints = rig.body.joints
    pelvis, rotations = torch.from_numpy(heads[:, skeleton.root]), torch.from_numpy(motion.rotations[:, joints])
    np.testing.assert_allclose(pose_heads(rig.body, pelvis, rotations).numpy(), heads[:, joints], atol=1e-6)
    made = rig.motion(pelvis, rotations, 30.0)
    np.testing.assert_allclose(positions_of(skeleton, made)[:, joints], heads[:, joints], atol=1e-5)
    assert (made.track_joints.tolist() == [1]) == above
    finger = skeleton.names.index("left_finger")
    assert finger not in joints
    local = roma.quat_product(
        roma.quat_conjugation(torch.from_numpy(made.rotations[:, skeleton.parents[finger]])),
        torch.from_numpy(made.rotations[:, finger]),
    )
    assert ((local * torch.from_numpy(rig.rest_local[finger])).sum(-1).abs() > 1 - 1e-5).all()


def test_joint_0_carries_the_pelvis_where_the_file_moves_no_pelvis():
    skeleton = humanoid(above=True)
    motion = swinging(skeleton, 8)
    rig = rig_of_motion(skeleton, motion)
    still = Rig(skeleton, rig.rest_local, rig.rest_root, pelvis_moves=False)
    pelvis = torch.from_numpy(positions_of(skeleton, motion)[:, skeleton.root])
    made = still.motion(pelvis, torch.from_numpy(motion.rotations[:, rig.body.joints]), 30.0)
    assert len(made.track_joints) == 0
    np.testing.assert_allclose(positions_of(skeleton, made)[:, skeleton.root], pelvis.numpy(), atol=1e-5)


def test_the_rest_pose_faces_one_way_however_the_figure_stood():
    skeleton = humanoid()
    motion = swinging(skeleton, 1)
    pelvis, turns = torch.zeros(1, 3), torch.from_numpy(motion.rotations)
    for angle in (0.0, 2.0, -2.0):
        yaw = torch.tensor(angle)
        stood = roma.quat_product(yaw_quaternions(yaw).expand_as(turns), turns)
        made = rig_of_motion(skeleton, rig_of_motion(skeleton, motion).motion(pelvis, stood, 30.0))
        heads = pose_heads(made.body, torch.zeros(3), made.body.rest_world)
        names = [skeleton.names[joint] for joint in made.body.joints]
        across = heads[names.index("left_leg")] - heads[names.index("right_leg")]
        assert across[0] > 0.15  # the left hip at +X
        if angle == 0:
            first = heads
        torch.testing.assert_close(heads, first, atol=1e-4, rtol=1e-4)
    assert not torch.allclose(turned(first, torch.tensor(1.0)), first, atol=0.1)


def test_it_travels_as_plain_data():
    skeleton = humanoid(above=True)
    rig = rig_of_motion(skeleton, swinging(skeleton, 5))
    again = Rig.of_plain(json.loads(json.dumps(rig.plain())))
    np.testing.assert_array_equal(again.rest_local, rig.rest_local)
    assert again.skeleton.names == skeleton.names and again.pelvis_moves
    np.testing.assert_array_equal(again.skeleton.tails, skeleton.tails)


@pytest.mark.parametrize(
    "damage",
    [
        lambda plain: plain.pop("rest_root"),
        lambda plain: plain.update(rest_local=[[0, 0, 0, 1]]),
        lambda plain: plain["skeleton"].update(parents=[0, 0]),
        lambda plain: plain["skeleton"].pop("header"),
        lambda plain: plain["skeleton"].update(root="pelvis"),
        lambda plain: plain.update(skeleton=None),
    ],
)
def test_damaged_plain_data_is_refused(damage):
    skeleton = humanoid()
    plain = rig_of_motion(skeleton, swinging(skeleton, 5)).plain()
    damage(plain)
    with pytest.raises(InputError, match="stored"):
        Rig.of_plain(plain)


def test_the_mean_of_rotations_minds_no_signs():
    turns = roma.rotvec_to_unitquat(0.1 * torch.randn(40, 3, generator=torch.Generator().manual_seed(0)))
    signs = torch.where(torch.arange(40) % 2 == 0, 1.0, -1.0).unsqueeze(1)
    mean = mean_rotations(turns * signs)
    assert 2 * mean[3].abs().clamp(max=1).acos() < 0.1


def test_a_rig_out_of_a_file(tmp_path):
    rig = rig_of_file("stages/shared/clips/walk.bvh")
    assert "HIERARCHY" in rig.skeleton.header
    heads = pose_heads(rig.body, torch.zeros(3), rig.body.rest_world)
    assert heads[:, 1].max() - heads[:, 1].min() > 0.8  # it stands
    one = rig_of_file("stages/shared/clips/walk.bvh", rest_frame=3)
    assert not np.allclose(one.rest_local, rig.rest_local)
    with pytest.raises(InputError):
        rig_of_file("stages/shared/clips/splits.json")
    with pytest.raises(InputError, match="Rest frame"):
        rig_of_file("stages/shared/clips/walk.bvh", rest_frame=10**6)
