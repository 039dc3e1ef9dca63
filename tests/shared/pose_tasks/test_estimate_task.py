"""The task `estimate`: it draws what a camera sees, does not depend on the batch, and knows what is missing."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from stages.shared.formats.rig_file import rig_of_file
from stages.shared.humanoid.landmarks import LANDMARKS
from stages.shared.kinematics.rotations import aligned_signs, from_turn_vectors, multiply
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose, outputs_of, pose_from_root
from stages.shared.pose_tasks.estimate import CAMERA_FEATURES, EstimateTask, see_keypoints
from stages.shared.pose_tasks.mirrored import mirror_of_rig
from tests.docs.pages import ROOT

_RIG = str(ROOT / "stages" / "shared" / "clips" / "walk.bvh")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return rig_of_file(_RIG)


def _clean(rig: Rig, windows: int = 3, frames: int = 12) -> tuple[BodyPose, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    joints = len(rig.body.joints)
    turns = 0.2 * torch.randn(windows, 1, joints, 3, generator=generator).expand(-1, frames, -1, -1)
    roots = torch.randn(windows, 1, 3, generator=generator) + torch.linspace(0, 1, frames).view(1, -1, 1)
    pose = BodyPose(roots, multiply(rig.body.rest_world.expand(windows, frames, -1, -1), from_turn_vectors(turns)))
    return pose, torch.ones(windows, frames, dtype=torch.bool)


def _rows(count: int, start: int = 0) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in range(start, start + count)]


@pytest.mark.parametrize("corruption", EstimateTask.corruptions)
def test_each_window_is_drawn_from_its_own_generator_only(rig: Rig, corruption: str):
    task = EstimateTask(rig, corruption)
    clean, valid = _clean(rig)
    whole = task.draw(clean, valid, _rows(3))
    part = task.draw(BodyPose(clean.roots[1:], clean.rotations[1:]), valid[1:], _rows(2, start=1))
    torch.testing.assert_close(part.features, whole.features[1:], atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(part.target.rotations, whole.target.rotations[1:], atol=1e-5, rtol=1e-4)
    assert whole.features.shape == (3, 12, task.features) and torch.isfinite(whole.features).all()


def test_the_papers_keypoints_are_the_joints_of_the_target_seen_from_the_front(rig: Rig):
    """Points of the target's heads, projected along -Z from where the camera must be, are the features."""
    task = EstimateTask(rig, "paper")
    clean, valid = _clean(rig)
    batch = task.draw(clean, valid, _rows(3))
    seen = batch.features[..., : 3 * task.points].unflatten(-1, (-1, 3))
    assert (seen[..., 2] == 1).all() and batch.given.all()
    heads = batch.target.heads(rig.body)
    sides = seen[..., 0].flatten(1), heads[..., 0].flatten(1)  # x to the right in both
    for one, other in zip(*sides, strict=True):
        assert np.corrcoef(one.numpy(), other.numpy())[0, 1] > 0.95
    camera = batch.features[0, 0, -CAMERA_FEATURES:]
    assert camera[-1] == 1 and camera[:2].abs().max() < 0.2  # the mean root is the principal point
    torch.testing.assert_close(batch.target.roots.mean(1), torch.zeros(3, 3), atol=1e-4, rtol=0)


def test_a_moved_motion_gives_the_same_batch(rig: Rig):
    """The camera is placed around the body."""
    task = EstimateTask(rig, "paper")
    clean, valid = _clean(rig)
    moved = BodyPose(clean.roots + torch.tensor([3.0, 0.0, -2.0]), clean.rotations)
    one, other = (task.draw(pose, valid, _rows(3)) for pose in (clean, moved))
    torch.testing.assert_close(one.features, other.features, atol=1e-3, rtol=1e-3)
    torch.testing.assert_close(one.target.roots, other.target.roots, atol=1e-4, rtol=1e-3)


def test_missing_points_do_not_matter_to_the_others():
    rng = np.random.default_rng(0)
    rays, trust = rng.normal(size=(2, 5, len(LANDMARKS), 2)), np.ones((2, 5, len(LANDMARKS)))
    rays[:, :, 3], trust[:, :, 3] = np.nan, 0
    one = see_keypoints(rays, trust, np.array([True, False]))
    rays[:, :, 3] = 1e6
    other = see_keypoints(rays, trust, np.array([True, False]))
    torch.testing.assert_close(one.features, other.features)
    scaled = see_keypoints(3 * rays + 0.5, trust, np.array([False, False]))
    torch.testing.assert_close(scaled.features[1], one.features[1], atol=1e-5, rtol=1e-4)
    trust[0, 2] = 0
    assert not see_keypoints(rays, trust, np.array([True, True])).given[0, 2]
    trust[1] = 0
    assert torch.isfinite(see_keypoints(rays, trust, np.array([True, True])).features).all()


def test_a_mirror_twice_is_the_motion_and_once_is_its_image(rig: Rig):
    mirror = mirror_of_rig(rig)
    assert mirror is not None
    clean, _ = _clean(rig)
    chosen = torch.tensor([True, False, True])
    once = mirror.mirrored(clean, chosen)
    twice = mirror.mirrored(once, chosen)
    torch.testing.assert_close(aligned_signs(twice.rotations, clean.rotations), clean.rotations)
    heads, image = clean.heads(rig.body), once.heads(rig.body)
    flip = torch.ones(3)
    flip[mirror.axis] = -1.0
    other = torch.as_tensor(mirror.other)
    torch.testing.assert_close(image[0], heads[0][:, other] * flip, atol=5e-3, rtol=0)
    torch.testing.assert_close(image[1], heads[1])


def test_outputs_of_zero_give_the_base_and_gradients_are_finite(rig: Rig):
    clean, _ = _clean(rig)
    outputs = torch.zeros(3, 12, outputs_of(rig.body), requires_grad=True)
    made = pose_from_root(outputs, clean)
    torch.testing.assert_close(aligned_signs(made.rotations, clean.rotations), clean.rotations, atol=1e-5, rtol=0)
    made.heads(rig.body).square().sum().backward()
    assert outputs.grad is not None and torch.isfinite(outputs.grad).all()


def test_measures_are_zero_for_the_truth(rig: Rig):
    task = EstimateTask(rig, "detector")
    clean, valid = _clean(rig)
    batch = task.draw(clean, valid, _rows(3))
    assert max(task.measures(batch.target, batch).values()) < 0.1
    assert task.measures(batch.base, batch)["mpjpe_mm"] > 10
    assert set(task.errors(batch.target, batch)) == {"position", "quaternion", "root", "velocity"}
