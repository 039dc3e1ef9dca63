"""Rotations of a BVH's rows: those of some frames are those of all, whatever channels turn, in long clips too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.shared.formats.bvh_header import BvhJoint
from stages.shared.formats.bvh_rows import RowRotations, local_quaternions
from stages.shared.kinematics.forward_numpy import BLOCK_FRAMES, joint_positions
from stages.shared.kinematics.rotations import multiply, rotate

ORDERS = ("ZXY", "ZXY", "XYZ", "Y", "ZX", "", "ZXY")


def _joints() -> tuple[BvhJoint, ...]:
    joints, column = [], 0
    for index, order in enumerate(ORDERS):
        channels = tuple(f"{axis}rotation" for axis in order)
        joints.append(BvhJoint(f"j{index}", index - 1, (0.0, 1.0, 0.0), channels, column, None, index + 1))
        column += len(channels)
    return tuple(joints)


@pytest.mark.parametrize("frames", [7, BLOCK_FRAMES, 2 * BLOCK_FRAMES + 3])
def test_rotations_of_some_rows_are_scipys(frames: int) -> None:
    joints = _joints()
    values = np.random.default_rng(frames).uniform(-400, 400, (frames, sum(map(len, ORDERS))))
    values[:, 1] = 0.0  # a channel that never turns, in one joint of several of its order
    values[: frames // 2, 4] = 0.0  # and one that turns late
    some = np.unique(np.linspace(0, frames - 1, 50).astype(int))
    found, whole = RowRotations(joints, values), local_quaternions(joints, values)
    assert found.shape == whole.shape == (len(found), len(joints), 4)
    assert found[some].tobytes() == whole[some].tobytes() and np.array_equal(found[2:6], whole[2:6])
    for index, joint in enumerate(joints):
        order = ORDERS[index]
        angles = values[:, joint.first_channel : joint.first_channel + len(order)]
        expected = Rotation.from_euler(order, angles, degrees=True) if order else Rotation.identity(frames)
        apart = (Rotation.from_quat(whole[:, index]) * expected.inv()).magnitude()
        assert apart.max() < 1e-6


@pytest.mark.parametrize("frames", [1, BLOCK_FRAMES, BLOCK_FRAMES + 1])
def test_positions_in_blocks_are_those_joint_by_joint(frames: int) -> None:
    rng = np.random.default_rng(frames)
    parents = np.array([-1, 0, 1, 1, 3], np.int32)
    turns = Rotation.random(frames * 5, random_state=1).as_quat().reshape(frames, 5, 4).astype(np.float32)
    root, offsets, tracks = rng.normal(size=(frames, 3)), rng.normal(size=(5, 3)), rng.normal(size=(frames, 1, 3))
    steps = np.tile(offsets, (frames, 1, 1))
    steps[:, 3:4] = tracks
    expected = np.zeros((frames, 5, 3))
    expected[:, 0] = root
    for joint in range(1, 5):
        above = parents[joint]
        expected[:, joint] = expected[:, above] + rotate(turns[:, above].astype(np.float64), steps[:, joint])
    assert np.array_equal(joint_positions(turns, root, offsets, parents, [3], tracks), expected)
    assert np.allclose(multiply(turns, turns)[..., 3], 2 * turns[..., 3] ** 2 - 1, atol=1e-5)
