"""Any cloud onto any skeleton: true, noisy, larger, lacking a group, with one key; and what must not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import roma
import torch

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.clouds import place_on_pose
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.drawn_points import draw_on_skeleton
from stages.shared.solve.following import FollowOptions, follow_cloud
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.scaling import fit_cloud, spread_scale
from stages.shared.solve.skeleton_pose import pose_of_motion
from stages.shared.solve.smoothing import smooth_as_needed
from stages.shared.solve.solving import SolveOptions
from tests.shared.inference.examples import humanoid, swinging
from tests.shared.inference.keyed_motions import junk, keys_every

FRAMES = 91


def cloud_of(skeleton: Skeleton, motion: Motion, points: int = 256, seed: int = 0):
    """Points (T, P, 3) and their groups, in random order."""
    rng = np.random.default_rng(seed)
    drawn = draw_on_skeleton(skeleton, points, rng, 0.05)
    order = torch.as_tensor(rng.permutation(points))
    return place_on_pose(drawn, pose_of_motion(skeleton, motion), skeleton)[:, order], drawn.groups[order]


def errors_mm(skeleton: Skeleton, made: Motion, truth: Motion) -> np.ndarray:
    """(T, S) distance of the sampled joints from the truth."""
    away = positions_of(skeleton, made) - positions_of(skeleton, truth)
    return 1000 * np.linalg.norm(away[:, skeleton.sampled], axis=-1)


@pytest.mark.parametrize("above", [False, True])
def test_a_true_cloud_gives_the_motion_back_and_reads_the_keys_alone(above: bool):
    skeleton = humanoid(above=above)
    motion, known = swinging(skeleton, FRAMES), keys_every(FRAMES, 15)
    points, groups = cloud_of(skeleton, motion)
    followed = follow_cloud(skeleton, junk(motion, known), known, points, groups)
    assert errors_mm(skeleton, followed.motion, motion).max() < 5
    assert errors_mm(skeleton, followed.motion, motion).mean() < 1
    assert (followed.motion.rotations[known] == motion.rotations[known]).all()
    if above:
        assert (followed.motion.tracks[known] == motion.tracks[known]).all()
    assert followed.scale == 1.0 and followed.noise_m < 1e-3
    finger = skeleton.names.index("left_finger")
    assert not followed.seen[finger] and followed.seen[skeleton.sampled].all()


def test_the_order_of_points_means_nothing():
    skeleton = humanoid()
    motion, known = swinging(skeleton, 31), keys_every(31, 15)
    points, groups = cloud_of(skeleton, motion)
    order = torch.randperm(256, generator=torch.Generator().manual_seed(3))
    one = follow_cloud(skeleton, motion, known, points, groups).motion
    other = follow_cloud(skeleton, motion, known, points[:, order], groups[order]).motion
    assert np.abs(errors_mm(skeleton, one, other)).max() < 0.5


def test_one_key_is_enough():
    """The base is a single held pose, a figure that has turned half round among what it must find."""
    skeleton = humanoid()
    motion = swinging(skeleton, FRAMES)
    turn = roma.rotvec_to_unitquat(torch.linspace(0, np.pi, FRAMES)[:, None] * torch.tensor([0.0, 1.0, 0.0]))
    turned = roma.quat_product(turn[:, None].expand(-1, skeleton.joints, -1), torch.as_tensor(motion.rotations))
    motion = replace(motion, rotations=turned.numpy())
    known = np.zeros(FRAMES, bool)
    known[0] = True
    followed = follow_cloud(skeleton, motion, known, *cloud_of(skeleton, motion))
    assert errors_mm(skeleton, followed.motion, motion).mean() < 15
    assert np.isnan(followed.noise_m)
    held = follow_cloud(
        skeleton, motion, known, *cloud_of(skeleton, motion), FollowOptions(solve=SolveOptions(rigid_start=False))
    )
    assert errors_mm(skeleton, followed.motion, motion).mean() < errors_mm(skeleton, held.motion, motion).mean()


@pytest.mark.parametrize("group", range(5))
def test_a_missing_group_keeps_to_the_keys_and_leaves_the_others_alone(group: int):
    skeleton = humanoid()
    motion, known = swinging(skeleton, 61), keys_every(61, 15)
    points, groups = cloud_of(skeleton, motion)
    some = groups != group
    followed = follow_cloud(skeleton, motion, known, points[:, some], groups[some])
    others = skeleton.groups[skeleton.sampled] != group
    assert errors_mm(skeleton, followed.motion, motion)[:, others].mean() < 12
    hidden = np.flatnonzero((skeleton.groups == group) & skeleton.sampled & (np.arange(skeleton.joints) > 2))
    assert not followed.seen[hidden].any()


@pytest.mark.parametrize("scale", [0.7, 1.3])
def test_a_cloud_of_another_size_is_found_out_and_followed(scale: float):
    skeleton = humanoid(above=True)
    motion, known = swinging(skeleton, FRAMES), keys_every(FRAMES, 15)
    points, groups = cloud_of(skeleton, motion)
    place = torch.tensor([3.0, -1.0, 2.0])
    cloud = scale * points + place
    followed = follow_cloud(skeleton, motion, known, cloud, groups, FollowOptions(scale=None))
    assert followed.scale == pytest.approx(scale, rel=5e-3)
    assert errors_mm(skeleton, followed.motion, motion).mean() < 2
    told = follow_cloud(skeleton, motion, known, cloud, groups, FollowOptions(scale=scale))
    assert told.scale == scale and errors_mm(skeleton, told.motion, motion).mean() < 2
    # From one key alone the spread tells it, to a few per cent.
    pose = pose_of_motion(skeleton, motion).rows(slice(0, 1)).world()
    assert spread_scale(cloud[:1], groups, skeleton, *pose) == pytest.approx(scale, rel=0.08)
    assert fit_cloud(cloud[:1], groups, skeleton, *pose).scale == pytest.approx(scale, rel=0.08)


def test_another_body_is_followed_by_how_its_bones_turn():
    skeleton = humanoid()
    motion, known = swinging(skeleton, FRAMES), keys_every(FRAMES, 15)
    longer = np.where(skeleton.groups >= 3, 1.25, 0.85)[:, None]
    body = replace(skeleton, offsets=skeleton.offsets * longer, tails=skeleton.tails * longer)
    points, groups = cloud_of(body, motion)
    angles = []
    for slack in (0.0, 0.1):
        solve = SolveOptions(point_noise_m=0.01, rigid_start=True, slack_m=slack)
        made = follow_cloud(skeleton, motion, known, points, groups, FollowOptions(solve=solve, scale=None)).motion
        away = (made.rotations * motion.rotations).sum(-1)[:, skeleton.sampled]
        angles.append(np.degrees(2 * np.arccos(np.clip(np.abs(away), 0, 1))).mean())
    assert angles[1] < angles[0] and angles[1] < 2


def test_noise_is_measured_and_smoothed_out():
    skeleton = humanoid()
    motion, known = swinging(skeleton, FRAMES), keys_every(FRAMES, 15)
    points, groups = cloud_of(skeleton, motion)
    noisy = points + 0.03 * torch.randn(points.shape, generator=torch.Generator().manual_seed(1))
    followed = follow_cloud(skeleton, motion, known, noisy, groups)
    raw = follow_cloud(skeleton, motion, known, noisy, groups, FollowOptions(smooth=False))
    assert followed.noise_m == pytest.approx(0.03, rel=0.15)
    assert errors_mm(skeleton, followed.motion, motion).mean() < 0.8 * errors_mm(skeleton, raw.motion, motion).mean()

    def jerk(made: Motion) -> float:
        return float(np.abs(np.diff(positions_of(skeleton, made)[:, skeleton.sampled], n=3, axis=0)).mean())

    assert jerk(raw.motion) > 5 * jerk(motion) and jerk(followed.motion) < 4 * jerk(motion)


def test_what_does_not_go_together_is_refused():
    skeleton = humanoid()
    motion = swinging(skeleton, 20)
    points, groups = cloud_of(skeleton, motion)
    with pytest.raises(UsageError, match="do not go"):
        follow_cloud(skeleton, motion, keys_every(20, 5), points[:10], groups)
    with pytest.raises(UsageError):
        follow_cloud(skeleton, motion, np.zeros(20, bool), points, groups)


def test_the_prior_knows_a_hinge_from_a_ball():
    angles = torch.linspace(-1, 1, 9)
    hinge = roma.rotvec_to_unitquat(angles[:, None] * torch.tensor([0.0, 0.6, 0.8]))
    ball = roma.rotvec_to_unitquat(torch.randn(9, 3, generator=torch.Generator().manual_seed(0)))
    still = torch.tensor([0.0, 0.0, 0.0, 1.0]).expand(9, 4)
    sizes = torch.linalg.inv(turn_prior(torch.stack([hinge, ball, still], 1), 0.5))
    axis = torch.tensor([0.0, 0.6, 0.8])
    across = torch.tensor([1.0, 0.0, 0.0])
    assert float(axis @ sizes[0] @ axis) == pytest.approx(0.25, rel=1e-3)
    assert float(across @ sizes[0] @ across) < 0.15**2 + 0.01
    assert torch.linalg.eigvalsh(sizes[1]).min() > 0.1
    assert torch.linalg.eigvalsh(sizes[2]).max() < 0.17**2
    open_joint = turn_prior(hinge[:1, None], 0.5)  # one key tells nothing
    torch.testing.assert_close(open_joint[0], torch.eye(3) / 0.25)


def test_smoothing_takes_noise_and_leaves_motion():
    times = np.arange(200)
    slow = np.stack([np.sin(times / 9), np.cos(times / 13), 0.01 * times], -1)
    np.testing.assert_allclose(smooth_as_needed(slow), slow, atol=2e-3)
    noise = 0.1 * np.random.default_rng(0).normal(size=slow.shape)
    left = smooth_as_needed(slow + noise) - slow
    assert left.std() < 0.5 * noise.std()
    np.testing.assert_allclose(smooth_as_needed(slow[:, :0], together=1), slow[:, :0])
