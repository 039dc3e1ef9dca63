"""Flags on clips with nothing wrong: straight legs on long feet, and bodies that stay in their place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.motion_quality import measure_quality as quality_of
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.playback_speed import SUSPECT

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"
EXCHANGED = np.array([0, 2, 1, 4, 3], np.int8)
SPINE = ("hips", "chest", "head")
LEG = ("hip", "knee", "ankle", "toes")


def standing_body(knee_back_m: float, hip_stub: bool) -> tuple[Skeleton, Motion]:
    """A body that faces +Z and stands on straight legs, its knees pressed back, with feet of 0.2 m and short toes.

    hip_stub: each leg begins with a joint in the pelvis' own place, as in AMC files.
    """
    names, parents, offsets, groups = list(SPINE), [-1, 0, 1], [[0, 1, 0], [0, 0.3, 0], [0, 0.3, 0]], [0, 0, 0]
    for side, group in ((1, 3), (-1, 4)):
        parent = 0
        steps = [[0.1 * side, 0, 0], [0, -0.45, -knee_back_m], [0, -0.45, knee_back_m], [0, -0.08, 0.2]]
        joints = list(LEG)
        if hip_stub:
            steps, joints = [[0, 0, 0], *steps], ["stub", *joints]
        for joint, step in zip(joints, steps, strict=True):
            names.append(f"{'left' if side > 0 else 'right'}_{joint}")
            parents.append(parent)
            offsets.append(step)
            groups.append(group)
            parent = len(names) - 1
    for side, group in ((1, 1), (-1, 2)):
        names += [f"{'left' if side > 0 else 'right'}_{joint}" for joint in ("shoulder", "hand")]
        parents += [1, len(parents)]
        offsets += [[0.2 * side, 0.2, 0], [0.5 * side, 0, 0]]
        groups += [group, group]
    places = np.array(offsets, float)
    tails = np.zeros_like(places)
    for joint in range(len(names)):
        below = [child for child, parent in enumerate(parents) if parent == joint]
        tails[joint] = places[below[0]] if below else [0, 0, 0.05]
    skeleton = Skeleton(
        tuple(names),
        np.array(parents, np.int32),
        places,
        tails,
        np.array(groups, np.int8),
        np.ones(len(names), bool),
        0,
    )
    rotations = np.tile([0.0, 0, 0, 1], (40, len(names), 1)).astype(np.float32)
    return skeleton, Motion(rotations, np.tile([0.0, 1, 0], (40, 1)).astype(np.float32), 30.0)


def measured(skeleton: Skeleton, motion: Motion):
    return quality_of(skeleton, motion, positions_of(skeleton, motion))


@pytest.mark.parametrize("hip_stub", [False, True])
@pytest.mark.parametrize("knee_back_m", [0.0, 0.02])
def test_straight_legs_on_long_feet_are_not_swapped_and_exchanged_ones_are(knee_back_m: float, hip_stub: bool):
    skeleton, motion = standing_body(knee_back_m, hip_stub)
    assert not measured(skeleton, motion).swapped
    assert measured(replace(skeleton, groups=EXCHANGED[skeleton.groups]), motion).swapped


def test_a_slow_bow_is_no_wrong_rate():
    """The upper body goes down and up again in four seconds; the feet and the pelvis stay."""
    skeleton, still = standing_body(0.0, False)
    frames = 120
    rotations = np.repeat(still.rotations[:1], frames, axis=0)
    angle = 0.8 * np.sin(np.linspace(0, np.pi, frames)) ** 2
    upper = [skeleton.names.index(name) for name in skeleton.names if skeleton.groups[skeleton.names.index(name)] < 3]
    bowed = Rotation.from_rotvec(angle[:, None] * [1.0, 0, 0]).as_quat()
    rotations[:, upper[1:]] = bowed[:, None]
    bow = Motion(rotations, np.repeat(still.root_positions[:1], frames, axis=0), 30.0)
    found = measured(skeleton, bow)
    assert found.speed_log2 is not None and found.speed_log2 < -SUSPECT and not found.wrong_rate


def test_a_walk_at_twice_its_speed_still_is():
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk"))
    assert not measured(skeleton, motion).wrong_rate
    assert measured(skeleton, replace(motion, fps=4 * motion.fps)).wrong_rate
