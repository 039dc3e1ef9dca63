"""Positions put back on the rig that they come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.shared.concepts.body_positions import (
    body_of,
    body_positions,
    heading_yaws,
    relative_poses,
    turned_about_y,
)
from stages.shared.concepts.posing import _best_turns, follow_positions
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"


def clip(name: str):
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / f"{name}.bvh").read_bytes(), name))
    return skeleton, motion, body_of(skeleton)


def test_its_own_positions_change_nothing():
    skeleton, motion, body = clip("kick")
    made = follow_positions(skeleton, motion, body, body_positions(skeleton, motion, body))
    aligned = np.abs((made.rotations * motion.rotations).sum(axis=-1))
    np.testing.assert_allclose(aligned, 1, atol=1e-5)
    np.testing.assert_allclose(made.root_positions, motion.root_positions, atol=1e-5)


def test_another_pose_of_the_same_bones_is_reached():
    """The positions of other frames of the clip: the same lengths, other poses."""
    skeleton, motion, body = clip("dance_a")
    targets = body_positions(skeleton, motion, body)[::-1]
    made = follow_positions(skeleton, motion, body, targets)
    found = body_positions(skeleton, made, body)
    apart = np.linalg.norm(found - targets, axis=-1)
    assert apart.mean() < 0.005, apart.mean()  # joints with several bones fit them in the mean only
    np.testing.assert_allclose(found[:, 0], targets[:, 0], atol=1e-5)


def test_relative_poses_do_not_depend_on_place_and_heading():
    skeleton, motion, body = clip("walk")
    places = body_positions(skeleton, motion, body)
    moved = turned_about_y(places, np.asarray(1.1)) + np.array([3.0, 0.5, -2.0])
    np.testing.assert_allclose(relative_poses(moved, body.groups), relative_poses(places, body.groups), atol=1e-6)
    np.testing.assert_allclose(heading_yaws(relative_poses(places, body.groups), body.groups), 0, atol=1e-6)


@pytest.mark.parametrize("name", ["kick", "walk"])
def test_the_body_has_the_pelvis_first_and_parents_before_children(name: str):
    skeleton, _, body = clip(name)
    assert body.joints[0] == skeleton.root and body.parents[0] == -1
    assert (body.parents[1:] < np.arange(1, len(body.parents))).all() and 0.5 < body.scale < 2


def test_a_joint_that_lies_on_its_parent_does_not_spin():
    """The hips of ASF files lie on the pelvis, so noise alone would say where they are from there."""
    skeleton, motion, _ = clip("walk")
    offsets = skeleton.offsets.copy()
    hips = [joint for joint, name in enumerate(skeleton.names) if name.endswith("hip")]
    assert len(hips) == 2
    offsets[hips] = 0
    skeleton = replace(skeleton, offsets=offsets)
    body = body_of(skeleton)
    rng = np.random.default_rng(0)
    targets = body_positions(skeleton, motion, body)
    made = follow_positions(skeleton, motion, body, targets + 0.001 * rng.standard_normal(targets.shape))
    aligned = np.abs((made.rotations * motion.rotations).sum(axis=-1)).clip(max=1)
    assert np.degrees(2 * np.arccos(aligned)).max() < 10


def test_what_vectors_on_one_line_do_not_say_is_no_turn():
    """Two shoulders on one line leave the turn around it open."""
    rng = np.random.default_rng(0)
    old = np.tile(np.array([[[1.0, 0, 0], [-1.0, 0, 0]]]), (50, 1, 1))
    new = Rotation.from_euler("z", 5, degrees=True).apply(old.reshape(-1, 3)).reshape(old.shape)
    old, new = (each + 1e-4 * rng.standard_normal(old.shape) for each in (old, new))
    found = _best_turns(old, new)
    np.testing.assert_allclose(np.degrees(found.magnitude()), 5, atol=0.1)
