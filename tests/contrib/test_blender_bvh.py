"""Bones in Blender -> BVH -> bones in Blender, against the project's own reader and forward kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_rows import layout_of, local_quaternions
from stages.shared.kinematics.forward_numpy import global_rotations, joint_positions
from tests.contrib.rigs import add_on, random_poses, random_rig

blender = add_on()


def heads_in_bvh(text: str) -> tuple[np.ndarray, np.ndarray]:
    """(T, J, 3) heads and (T, J, 3, 3) rotations in the world of a BVH, as pumps reads it."""
    bvh = read_bvh(text.encode(), "sent.bvh")
    layout = layout_of(bvh.joints)
    parents = np.array([joint.parent for joint in bvh.joints])
    offsets = np.tile([joint.offset for joint in bvh.joints], (bvh.frames, 1, 1))
    offsets[:, layout.position_joints, layout.position_axes] = bvh.values[:, layout.position_columns]
    turns = global_rotations(local_quaternions(bvh.joints, bvh.values), parents)
    moving = range(1, len(parents))
    heads = joint_positions(turns, offsets[:, 0], offsets[0], parents, moving, offsets[:, 1:])
    return heads, Rotation.from_quat(turns.reshape(-1, 4)).as_matrix().reshape(*turns.shape[:2], 3, 3)


rigs = {"seed": st.integers(0, 2**32 - 1), "joints": st.integers(1, 14), "sliding": st.booleans()}


@settings(max_examples=40, deadline=None)
@given(**rigs)
def test_pumps_reads_every_head_where_blender_has_it(seed: int, joints: int, sliding: bool) -> None:
    rng = np.random.default_rng(seed)
    rig = random_rig(rng, joints)
    poses = random_poses(rng, rig, 4, sliding)
    heads, turns = heads_in_bvh(blender.bvh_of(rig, poses, 24.0))
    x, y, z = np.moveaxis(poses[..., :3, 3], -1, 0)
    np.testing.assert_allclose(heads, np.stack([x, z, -y], axis=-1), atol=1e-5)
    # A turn of the BVH takes a bone's direction at rest to its direction in the pose.
    rest, posed = rig.rest[:, :3, 1], poses[..., :3, 1]
    turned = (turns @ (rest[:, [0, 2, 1]] * [1, 1, -1])[..., None])[..., 0]
    np.testing.assert_allclose(turned, posed[..., [0, 2, 1]] * [1, 1, -1], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(**rigs)
def test_bones_come_back_as_they_were(seed: int, joints: int, sliding: bool) -> None:
    rng = np.random.default_rng(seed)
    rig = random_rig(rng, joints)
    poses = random_poses(rng, rig, 4, sliding)
    back = blender.matrices_of(blender.bvh_of(rig, poses, 24.0), rig)
    np.testing.assert_allclose(back[..., :3, 3], poses[..., :3, 3], atol=1e-5)
    np.testing.assert_allclose(back, poses, atol=1e-5)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-1e-6, 1e-6), st.sampled_from((-90.0, 90.0)))
def test_angles_are_right_where_two_axes_are_nearly_parallel(seed: int, away: float, level: float) -> None:
    z, y = np.random.default_rng(seed).uniform(-180, 180, 2)
    turns = Rotation.from_euler("ZXY", [[z, level + np.degrees(away), y]], degrees=True).as_matrix()
    again = Rotation.from_euler("ZXY", blender._angles(turns)).as_matrix()
    np.testing.assert_allclose(again, turns, atol=1e-6)
    np.testing.assert_allclose(blender._turns(blender._angles(turns)), turns, atol=1e-6)


def test_a_scale_changes_no_rotation() -> None:
    rng = np.random.default_rng(3)
    rig = random_rig(rng, 6)
    poses = random_poses(rng, rig, 3, False)
    large = poses.copy()
    large[..., :3, :3] *= 100.0
    assert blender.bvh_of(rig, large, 30.0) == blender.bvh_of(rig, poses, 30.0)


def test_only_bones_that_slide_have_position_channels() -> None:
    rng = np.random.default_rng(5)
    rig = random_rig(rng, 9)
    still = read_bvh(blender.bvh_of(rig, random_poses(rng, rig, 3, False), 30.0).encode(), "still")
    sliding = read_bvh(blender.bvh_of(rig, random_poses(rng, rig, 3, True), 30.0).encode(), "sliding")
    assert [len(joint.channels) for joint in still.joints] == [6] + [3] * 8
    assert [len(joint.channels) for joint in sliding.joints] == [6, 6, 3, 3, 6, 3, 3, 6, 3]
    assert [joint.parent for joint in still.joints] == rig.parents.tolist()


def test_angles_go_on_from_frame_to_frame() -> None:
    rng = np.random.default_rng(7)
    rig = random_rig(rng, 1)
    poses = np.tile(rig.rest, (40, 1, 1, 1))
    spin = Rotation.from_euler("z", np.arange(40)[:, None] * 30, degrees=True).as_matrix()
    poses[..., :3, :3] = spin[:, None] @ poses[..., :3, :3]
    values = read_bvh(blender.bvh_of(rig, poses, 30.0).encode(), "spin").values
    assert np.abs(np.diff(values[:, 3:], axis=0)).max() < 31


def test_a_result_of_another_rig_is_refused() -> None:
    rng = np.random.default_rng(9)
    rig, other = random_rig(rng, 5), random_rig(rng, 6)
    text = blender.bvh_of(other, random_poses(rng, other, 2, False), 30.0)
    with pytest.raises(blender.Refused, match="other joints"):
        blender.matrices_of(text, rig)
    with pytest.raises(blender.Refused, match="other joints"):
        blender.matrices_of("", rig)
    cut = text.rsplit(" ", 1)[0] + "\n"
    with pytest.raises(blender.Refused, match="another length"):
        blender.matrices_of(cut, other)
