"""Limits on turns and accelerations: a larger step is found where it is, and its gap alone is put back."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.inference.pop_limits import NEAR_S, PopLimits, Steps, without_pops
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.statistics.feel_pops import largest_acceleration_mps2, largest_turn_deg
from stages.shared.statistics.measurements import measured_joints
from tests.shared.inference.test_foot_lock import interpolated

FPS = 30.0


def test_steps_are_those_of_the_measured_pops():
    skeleton, _, filled, _ = interpolated("dance_a", 15)
    steps = Steps.of_pose(SkeletonPose.of_motion(skeleton, filled))
    joints, places = measured_joints(skeleton), SkeletonPose.of_motion(skeleton, filled).heads.numpy()
    everything = np.ones(filled.frames, bool)
    turn = largest_turn_deg(filled.rotations[None][:, :, joints], everything)[0]
    np.testing.assert_allclose(np.degrees(steps.turns.max()), turn)
    np.testing.assert_allclose(
        FPS**2 * steps.bends.max(), largest_acceleration_mps2(places[None][:, :, joints], everything)[0]
    )


@settings(max_examples=40, deadline=None)
@given(st.integers(5, 200), st.integers(0, 2**32 - 1))
def test_limits_are_the_largest_filled_step_near_as_a_loop_finds_it(frames: int, seed: int):
    rng = np.random.default_rng(seed)
    known = rng.random(frames) < 0.3
    steps = Steps(rng.random(frames - 1), rng.random(frames - 2))
    limits = PopLimits.of(steps, known, FPS)
    for part, limit, width in ((steps.turns, limits.turns, 2), (steps.bends, limits.bends, 3)):
        filled = [part[i] if not known[i : i + width].all() else 0.0 for i in range(len(part))]
        near = round(NEAR_S * FPS)
        np.testing.assert_array_equal(limit, [max(filled[max(i - near, 0) : i + near + 1]) for i in range(len(part))])
    assert len(limits.broken_frames(steps, known)) == 0


def test_a_pop_puts_its_gap_back_and_no_other():
    skeleton, _, filled, known = interpolated("walk", 10)
    pose = SkeletonPose.of_motion(skeleton, filled)
    gaps = np.flatnonzero(~known)
    turned = pose.rotations.clone()
    knee = int(np.flatnonzero(skeleton.groups == 3)[1])
    turned[4, knee] = turned[4, knee].roll(1)  # a pop in the first gap
    half = pose.rotations[14, knee] + 1e-4
    turned[14, knee] = half / half.norm()  # a small change in the second
    changed = pose.with_rows(
        gaps, SkeletonPose(skeleton, turned, True, pose.roots, pose.offsets, pose.track_joints).rows(gaps)
    )
    out = without_pops(pose, changed, known, FPS)
    assert np.array_equal(out.rotations[:10].numpy(), pose.rotations[:10].numpy())
    assert np.array_equal(out.rotations[10:].numpy(), changed.rotations[10:].numpy())
    assert not np.array_equal(out.rotations[14].numpy(), pose.rotations[14].numpy())
