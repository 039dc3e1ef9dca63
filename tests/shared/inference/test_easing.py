"""Easing out of keys: no kink, nothing changed at keys or far from them, and straight motion left alone."""

from __future__ import annotations

import numpy as np
import pytest
import roma
import torch

from data_schemas.skeleton import Skeleton
from stages.shared.inference.easing import ease_at_keys
from stages.shared.solve.skeleton_pose import SkeletonPose


def pose_of(roots: np.ndarray, angles: np.ndarray) -> SkeletonPose:
    turns = torch.as_tensor(angles, dtype=torch.float32)[:, None, None] * torch.tensor([0.0, 0.0, 1.0])
    bone = np.zeros((1, 3))
    skeleton = Skeleton(("root",), np.array([-1]), bone, bone, np.zeros(1, np.int8), np.ones(1, bool), root=0)
    places = torch.as_tensor(roots, dtype=torch.float32)
    return SkeletonPose(
        skeleton, roma.rotvec_to_unitquat(turns), False, places, torch.zeros(1, 3), np.zeros(0, np.int32)
    )


def angles_of(pose: SkeletonPose) -> np.ndarray:
    return roma.unitquat_to_rotvec(pose.local)[:, 0, 2].numpy()


def kinked(frames: int = 60, stop: int = 20):
    """Known frames that move, then a gap that stands still up to known frames that stand."""
    path = np.minimum(np.arange(frames), stop) * 0.01
    known = np.ones(frames, bool)
    known[stop + 1 : 50] = False
    return pose_of(np.stack([path, path, 0 * path], -1), path), known


def test_the_gap_goes_on_as_the_key_was_reached():
    pose, known = kinked()
    eased = ease_at_keys(pose, known, 30.0, 0.4)
    for path in (eased.roots[:, 0].numpy(), angles_of(eased)):
        steps = np.diff(path)
        assert abs(steps[20] - 0.01) < 0.003 and abs(steps[20] - steps[19]) < 0.4 * 0.01
        np.testing.assert_allclose(path[32:49], 0.2, atol=1e-6)  # 0.4 s later all is as it was
    assert torch.equal(eased.local[known], pose.local[known]) and torch.equal(eased.roots[known], pose.roots[known])


def test_at_a_high_rate_the_gap_can_go_on_as_the_last_step():
    """Of a body that gets faster, the mean of several steps is slower than the last one."""
    frames, fps = 240, 120.0
    path = np.minimum(np.arange(frames), 80) ** 2 * 1e-4
    known = np.ones(frames, bool)
    known[81:200] = False
    pose = pose_of(np.stack([path, path, 0 * path], -1), path)
    whole = ease_at_keys(pose, known, fps, 0.4)
    eased = ease_at_keys(whole, known, fps, 0.2, behind_s=0.0)
    jumps = [abs(np.diff(each.roots[:, 0].numpy(), n=2)[79]) for each in (pose, whole, eased)]
    usual = abs(np.diff(path, n=2)[:79]).mean()
    assert jumps[0] > 50 * usual and jumps[1] > 1.2 * usual and jumps[2] < 0.5 * usual
    assert torch.equal(eased.roots[known], pose.roots[known])


def test_a_lone_key_is_met_halfway_from_both_sides():
    frames = np.arange(41)
    path = np.abs(frames - 20) * 0.01
    known = np.zeros(41, bool)
    known[[0, 20, 40]] = True
    pose = pose_of(np.stack([path, 0 * path, 0 * path], -1), path)
    eased = ease_at_keys(pose, known, 30.0, 0.4)
    for before, after in ((pose.roots[:, 0].numpy(), eased.roots[:, 0].numpy()), (angles_of(pose), angles_of(eased))):
        assert abs(np.diff(after, 2)[19]) < 0.25 * abs(np.diff(before, 2)[19])
        np.testing.assert_allclose(after, after[::-1], atol=1e-5)


def test_steady_motion_and_no_span_change_nothing():
    path = 0.02 * np.arange(30)
    known = np.zeros(30, bool)
    known[::7] = True
    pose = pose_of(np.stack([path, path, path], -1), path)
    eased = ease_at_keys(pose, known, 30.0, 0.4)
    np.testing.assert_allclose(eased.roots.numpy(), pose.roots.numpy(), atol=1e-5)
    assert ease_at_keys(pose, known, 30.0, 0.0) is pose


@pytest.mark.parametrize("fps", [24.0, 120.0])
def test_gaps_of_one_frame_and_at_the_ends(fps: float):
    path = np.random.default_rng(0).normal(size=12) * 0.1
    for hidden in ([5], [0, 1], [10, 11], [1, 3, 5, 7, 9]):
        known = np.ones(12, bool)
        known[hidden] = False
        pose = pose_of(np.stack([path, path, path], -1), path)
        eased = ease_at_keys(pose, known, fps, 0.4)
        assert torch.isfinite(eased.local).all() and torch.isfinite(eased.roots).all()
        assert torch.equal(eased.roots[known], pose.roots[known])
