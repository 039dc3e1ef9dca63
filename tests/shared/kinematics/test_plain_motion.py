"""Plain interpolation of what is known of each joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pumps
from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.plain_motion import plain_motion

CLIP = Path("stages/shared/clips/walk.bvh")


def test_each_joint_goes_between_its_own_keys() -> None:
    walk = pumps.load(CLIP)
    skeleton, motion = walk.skeleton, walk.record
    joints = np.zeros((motion.frames, skeleton.joints), bool)
    position = np.zeros(motion.frames, bool)
    legs, rest = slice(1, 5), [0, *range(5, skeleton.joints)]
    joints[:, legs] = True
    joints[np.ix_([0, 60, motion.frames - 1], rest)] = True
    position[[0, 30, motion.frames - 1]] = True
    made = plain_motion(skeleton, motion, joints, position)
    own, true = (local_rotations_of(skeleton, each) for each in (made, motion))
    same = np.abs((own * true).sum(-1))
    assert (same[joints] > 1 - 1e-5).all()
    assert (same[:, rest] < 1 - 1e-4).any(axis=1)[1:60].mean() > 0.9
    np.testing.assert_allclose(made.root_positions[position], motion.root_positions[position], atol=1e-5)
    middle = (motion.root_positions[0] + motion.root_positions[30]) / 2
    np.testing.assert_allclose(made.root_positions[15], middle, atol=1e-4)
    assert np.abs(made.root_positions[60] - motion.root_positions[60]).max() > 0.01
