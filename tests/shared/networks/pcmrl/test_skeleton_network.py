"""The network from clouds to a rig's pose, and the terms on its skeleton."""

import numpy as np
import pytest
import roma
import torch

from stages.shared.networks.layers.row_generator import row_generator
from stages.shared.networks.layers.sizes import EncoderSizes, SkeletonSizes
from stages.shared.networks.pcmrl.skeleton_losses import end_bones, end_effector_loss, roll_loss, unit_quaternion_loss
from stages.shared.networks.pcmrl.skeleton_network import SkeletonNetwork, draw_own_points, group_moments
from stages.shared.pointcloud.heading import turned, yaw_quaternions
from stages.shared.pointcloud.rig import RigBody, pose_heads, rig_of_motion
from tests.shared.inference.examples import humanoid, swinging

TIMES = torch.arange(7.0).unsqueeze(0)


@pytest.fixture(scope="module")
def body() -> RigBody:
    skeleton = humanoid()
    return rig_of_motion(skeleton, swinging(skeleton, 9)).body


@pytest.fixture(scope="module")
def network(body) -> SkeletonNetwork:
    torch.manual_seed(0)
    encoder = EncoderSizes(width=8, blocks=2, neighbours=4, heads=2)
    made = SkeletonNetwork(body, encoder, SkeletonSizes(width=16, layers=1, heads=2))
    with torch.no_grad():
        made.out.weight.mul_(30)  # so that the poses differ from the rest pose
    return made.eval()


def cloud(seed: int = 0, points: int = 30) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    groups = torch.arange(points).expand(2, -1) % 5
    sides = torch.tensor([0, 0.5, -0.5, 0.2, -0.2])[groups]
    places = torch.randn(2, 7, points, 3, generator=generator) * 0.3
    places[..., 0] += sides.unsqueeze(1)
    return places, groups


def test_shapes_and_unit_rotations(network, body):
    pose = network(*cloud(), TIMES)
    assert pose.heads.shape == (2, 7, 11, 3) and pose.rotations.shape == (2, 7, 11, 4)
    assert pose.raw.shape == (2, 7, 11, 4)
    torch.testing.assert_close(pose.rotations.norm(dim=-1), torch.ones(2, 7, 11))
    torch.testing.assert_close(pose_heads(body, pose.heads[:, :, 0], pose.rotations), pose.heads)


def test_the_order_of_points_means_nothing(network):
    points, groups = cloud()
    order = torch.randperm(30, generator=torch.Generator().manual_seed(1))
    pose, other = network(points, groups, TIMES), network(points[:, :, order], groups[:, order], TIMES)
    torch.testing.assert_close(pose.heads, other.heads, atol=1e-4, rtol=1e-4)


def test_a_cloud_that_is_moved_and_turned_moves_and_turns_the_pose(network):
    points, groups = cloud()
    yaw, shift = torch.tensor(2.2), torch.tensor([3.0, -1, 20])
    pose, other = network(points, groups, TIMES), network(turned(points, yaw) + shift, groups, TIMES)
    torch.testing.assert_close(other.heads, turned(pose.heads, yaw) + shift, atol=1e-3, rtol=1e-3)
    turns = roma.quat_product(yaw_quaternions(yaw).expand_as(pose.rotations), pose.rotations)
    assert ((turns * other.rotations).sum(-1).abs() > 1 - 1e-4).all()


def test_padding_changes_nothing(network):
    points, groups = cloud()
    valid = torch.ones(2, 7, dtype=torch.bool)
    valid[:, 5:] = False
    broken = points.clone()
    broken[:, 5:] *= -9
    pose, other = network(points, groups, TIMES, valid), network(broken, groups, TIMES, valid)
    torch.testing.assert_close(pose.heads[:, :5], other.heads[:, :5], atol=1e-4, rtol=1e-4)


def test_it_starts_from_the_rest_pose(body):
    torch.manual_seed(0)
    fresh = SkeletonNetwork(
        body, EncoderSizes(width=8, blocks=2), SkeletonSizes(width=16, layers=1, heads=2, heading=False)
    )
    with torch.no_grad():
        fresh.out.weight.zero_()
    pose = fresh(*cloud(), TIMES)
    assert ((pose.rotations * body.rest_world).sum(-1).abs() > 1 - 1e-5).all()
    points, _ = cloud()
    torch.testing.assert_close(pose.heads[:, :, 0], points.mean(2), atol=1e-5, rtol=1e-4)


def test_bones_that_no_point_sees_rest_in_their_parents_frames(body):
    unseen = 4
    weights = body.weights.clone()
    weights[unseen] = 0
    part = RigBody(**{**vars(body), "weights": weights})
    torch.manual_seed(0)
    network = SkeletonNetwork(part, EncoderSizes(width=8, blocks=2), SkeletonSizes(width=16, layers=1, heads=2))
    pose = network(*cloud(), TIMES)
    assert pose.raw.shape[2] == len(body.joints) - 1
    parent = int(body.parents[unseen])
    rest = roma.quat_product(pose.rotations[:, :, parent], body.rest_local[unseen].expand(2, 7, 4))
    torch.testing.assert_close(pose.rotations[:, :, unseen], rest)
    points = draw_own_points(
        part, torch.tensor([0.05, 0.05]), torch.arange(500).expand(2, -1) % 5, torch.Generator().manual_seed(0)
    )
    assert unseen not in points.bones


def test_own_points_ride_on_the_pose(network, body):
    """Against place = head + R (alpha tail + sigma offset) (PC-MRL eq. 3), at sigma 0: on the bones' lines."""
    pose = network(*cloud(), TIMES)
    asked = torch.arange(40).expand(2, -1) % 5
    own = draw_own_points(body, torch.tensor([0.0, 0.05]), asked, torch.Generator().manual_seed(0))
    points = own.place(pose.heads, pose.rotations)
    assert points.shape == (2, 7, 40, 3)
    heads, turns = pose.heads[0][:, own.bones[0]], pose.rotations[0][:, own.bones[0]]
    torch.testing.assert_close(points[0], heads + roma.quat_action(turns, own.in_bone[0].expand(7, -1, 3)))
    tails = body.tails[own.bones[0]]
    assert torch.linalg.cross(own.in_bone[0], tails).norm(dim=-1).max() < 1e-6
    assert (own.groups == asked).all() and (body.groups[own.bones] == asked).all()


def test_bones_are_drawn_by_their_lengths_and_by_the_row(body):
    spine = torch.zeros(2, 4000, dtype=torch.long)
    own = draw_own_points(body, torch.tensor([0.05, 0.05]), spine, torch.Generator().manual_seed(0))
    share = torch.bincount(own.bones.flatten(), minlength=len(body.joints)) / 8000
    expected = torch.where(body.groups == 0, body.weights, 0)
    torch.testing.assert_close(share, expected / expected.sum(), atol=0.03, rtol=0)
    rows = row_generator(0, [5, 6], torch.device("cpu"))
    both = draw_own_points(body, torch.tensor([0.05, 0.05]), spine, rows)
    one = draw_own_points(body, torch.tensor([0.05]), spine[:1], row_generator(0, [6], torch.device("cpu")))
    torch.testing.assert_close(both.in_bone[1:], one.in_bone)
    lacking = RigBody(**{**vars(body), "groups": torch.zeros_like(body.groups)})
    assert (draw_own_points(lacking, torch.tensor([0.05]), spine[:1] + 3, torch.Generator()).groups == 0).all()


def test_moments_are_means_and_covariances():
    points, groups = (part[0] for part in cloud())
    found = group_moments(points, groups.expand(7, -1)).view(7, -1)
    places = 2 * (points - points.mean(1, keepdim=True))
    arm = places[3, groups == 1].numpy()
    np.testing.assert_allclose(found[3].view(5, 9)[1, :3], arm.mean(0), atol=1e-5)
    np.testing.assert_allclose(
        found[3].view(5, 9)[1, 3:], 4 * np.cov(arm.T, bias=True)[np.triu_indices(3)], atol=1e-5
    )


def test_every_weight_gets_a_gradient(body):
    torch.manual_seed(0)
    network = SkeletonNetwork(body, EncoderSizes(width=8, blocks=2), SkeletonSizes(width=16, layers=1, heads=2))
    pose = network(*cloud(), TIMES)
    (pose.heads.square().sum() + unit_quaternion_loss(pose.raw)).backward()
    for name, value in network.named_parameters():
        # The last block of so small an encoder pools one point; a bias that a softmax does not see learns nothing.
        if not name.startswith("encoder.attention.1") and not name.endswith("score.bias"):
            assert value.grad is not None and value.grad.abs().sum() > 0, name


def test_the_unit_quaternion_loss_is_the_squared_difference_of_lengths():
    raw = torch.tensor([[[[0.0, 0, 0, 2], [1, 0, 0, 0]], [[0, 3, 0, 0], [0, 0, 0, 1]]]])
    assert unit_quaternion_loss(raw).item() == pytest.approx((1 + 0 + 4 + 0) / 4)
    assert unit_quaternion_loss(raw, torch.tensor([[True, False]])).item() == pytest.approx(0.5)


@pytest.mark.parametrize("angle", [0.0, 0.8, np.pi])
def test_the_roll_loss_is_sin_squared_of_half_the_roll(body, angle):
    """Every bone below the pelvis swings somewhere by the shortest way, then rolls about itself; so do those that
    hang on it, so that only its own roll against its parent counts."""
    rest = body.rest_world
    generator = torch.Generator().manual_seed(0)
    out = [rest[0]]
    for bone in range(1, len(rest)):
        axis = body.tails[bone] / body.tails[bone].norm()
        across = torch.linalg.cross(torch.randn(3, generator=generator), axis)
        swing = roma.rotvec_to_unitquat(0.7 * across / across.norm())
        roll = roma.rotvec_to_unitquat(angle * axis)
        local = roma.quat_product(body.rest_local[bone], roma.quat_product(swing, roll))
        out.append(roma.quat_product(out[int(body.parents[bone])], local))
    loss = roll_loss(torch.stack(out).view(1, 1, -1, 4), body)
    assert loss.item() == pytest.approx(np.sin(angle / 2) ** 2, abs=1e-3)


def test_end_bones_are_where_head_hands_and_feet_begin():
    """With toes and without, with an offset joint at the hip: the ankle."""
    names = [
        "hips",
        "head",
        "hip",
        "thigh",
        "shin",
        "foot",
        "toe",
        "left_hip",
        "left_thigh",
        "left_shin",
        "arm",
        "fore",
    ]
    parents = np.array([-1, 0, 0, 2, 3, 4, 5, 0, 7, 8, 0, 10])
    groups = np.array([0, 0, 4, 4, 4, 4, 4, 3, 3, 3, 1, 1])
    tails = np.zeros((12, 3))
    tails[:, 1] = [0.1, 0.2, 0.1, 0.4, 0.4, 0.2, 0.05, 0.1, 0.4, 0.4, 0.3, 0.3]
    found = end_bones(parents, groups, tails, np.ones(12))
    assert [names[end] if end >= 0 else None for end in found] == ["head", None, None, None, "foot"]
    left_foot = end_bones(np.append(parents, 9), np.append(groups, 3), np.vstack([tails, [0, 0.1, 0]]), np.ones(13))
    assert left_foot == [1, -1, -1, 12, 5]


def test_the_end_effector_loss_sums_pairs_and_means_time():
    one = torch.zeros(2, 3, 5, 3)
    two = torch.zeros(2, 3, 5, 3)
    two[0, :, 1, 0], two[1, 2, 4, 1] = 0.5, 3.0
    every = [True] * 5
    assert end_effector_loss(one, two, every, None).item() == pytest.approx((0.5 + 1.0) / 2)
    assert end_effector_loss(one, two, [True, False, True, True, True], None).item() == pytest.approx(0.5)
    valid = torch.tensor([[True, True, True], [True, True, False]])
    assert end_effector_loss(one, two, every, valid).item() == pytest.approx(0.25)
