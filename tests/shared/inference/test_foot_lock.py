"""Held feet: they slide less, keys stay bit for bit, knees bend the way they did, nothing pops; on real clips."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.inference.filled import skates
from stages.shared.inference.foot_lock import LOOSE, SMOOTH_S, _pieces, _smooth, lock_feet
from stages.shared.inference.pop_limits import ROUNDING
from stages.shared.inference.standing_feet import contact_heights, lowered_feet, standing_feet
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.foot_contacts import find_feet, limb_joints
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.plain_interpolation import damped_smoothness
from stages.shared.solve.skeleton_pose import SkeletonPose, pose_of_motion, replace_rows
from stages.shared.statistics.feel_pops import largest_acceleration_mps2, largest_turn_deg
from tests.shared.inference.keyed_motions import keys_every

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"


@lru_cache
def interpolated(name: str, step: int) -> tuple[Skeleton, Motion, Motion, np.ndarray]:
    """A clip, and the plain interpolation of its keys."""
    path = CLIPS / f"{name}.bvh"
    skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), str(path)))
    known = keys_every(motion.frames, step)
    keys, gaps = np.flatnonzero(known), np.flatnonzero(~known)
    times = torch.as_tensor(keys).double()
    pose = pose_of_motion(skeleton, motion.at(keys))
    between = pose.at(times, torch.as_tensor(gaps).double(), damped_smoothness(times, motion.fps))
    return skeleton, motion, replace_rows(skeleton, motion, between, gaps), known


def locked_motion(skeleton: Skeleton, filled: Motion, known: np.ndarray) -> Motion:
    return lock_feet(SkeletonPose.of_motion(skeleton, filled), known, filled.fps).motion(filled.fps)


@pytest.mark.parametrize(
    ("name", "step", "most"),
    [("walk", 15, 0.7), ("walk", 10, 0.78), ("dance_a", 15, 0.7), ("crawl", 15, 0.7), ("punch", 20, 0.7)],
)
def test_feet_slide_less_and_keys_stay(name: str, step: int, most: float):
    skeleton, _, filled, known = interpolated(name, step)
    locked = locked_motion(skeleton, filled, known)
    loose, held = (SkeletonPose.of_motion(skeleton, motion) for motion in (filled, locked))
    before, after = skates(loose, known, filled.fps, loose, held)
    assert after < most * before
    for field in ("rotations", "root_positions", "tracks"):
        ours, theirs = getattr(locked, field), getattr(filled, field)
        assert ours[known].tobytes() == theirs[known].tobytes()
    # Only legs move.
    legs = np.isin(skeleton.groups, (3, 4))
    upper = positions_of(skeleton, locked)[:, ~legs] - positions_of(skeleton, filled)[:, ~legs]
    assert np.abs(upper).max() < 2e-3


@pytest.mark.parametrize("name", ["walk", "dance_a"])
def test_knees_do_not_flip_and_nothing_pops(name: str):
    skeleton, truth, filled, known = interpolated(name, 15)
    locked = locked_motion(skeleton, filled, known)
    feet = find_feet(skeleton)

    knees = [chain[1] for chain in feet.chains]

    def bends(motion: Motion) -> np.ndarray:
        """(T, 2, 3) the knees' local rotation vectors."""
        local = pose_of_motion(skeleton, motion).local[:, knees]
        return roma.unitquat_to_rotvec(torch.where(local[..., 3:] < 0, -local, local)).numpy()

    axis = np.linalg.svd(bends(truth).reshape(-1, 3), full_matrices=False)[2][0]
    angles, true_angles = bends(locked) @ axis, bends(truth) @ axis
    assert true_angles.min() - 0.2 < angles.min() and angles.max() < true_angles.max() + 0.2
    sideways = bends(locked) - angles[..., None] * axis
    assert np.abs(sideways).max() < 0.1 + np.abs(bends(truth) - true_angles[..., None] * axis).max()

    def third(motion: Motion) -> np.ndarray:
        return np.linalg.norm(np.diff(positions_of(skeleton, motion), n=3, axis=0), axis=-1)

    assert third(locked).max() < 1.5 * third(truth).max()
    steps = [np.linalg.norm(np.diff(positions_of(skeleton, m), axis=0), axis=-1).max() for m in (locked, truth)]
    assert steps[0] < 1.5 * steps[1]


def test_a_foot_that_slides_between_two_keys_in_one_place_is_found():
    skeleton, _, filled, known = interpolated("walk", 15)
    feet = find_feet(skeleton)
    places = positions_of(skeleton, filled)
    contacts = standing_feet(places, feet, filled.fps, known)
    assert 0.1 < contacts.mean() < 0.95


def test_nothing_hidden_nothing_changed():
    skeleton, motion, _, _ = interpolated("walk", 15)
    pose = SkeletonPose.of_motion(skeleton, motion)
    assert lock_feet(pose, np.ones(motion.frames, bool), motion.fps) is pose


def test_shifts_are_the_same_at_any_rate_and_meet_their_keys():
    at_30, at_240 = np.zeros((61, 3)), np.zeros((481, 3))
    at_30[20:40], at_240[160:320] = 0.1, 0.1
    found = []
    for wanted, step in ((at_30, 1), (at_240, 8)):
        known = np.zeros(len(wanted), bool)
        known[[0, 30 * step, 60 * step]] = True
        found.append(_smooth(wanted, wanted[:, 0] != 0, known, 30.0 * step)[::step])
        assert np.abs(np.diff(_smooth(wanted, wanted[:, 0] != 0, known, 30.0 * step), axis=0)).max() < 0.05 / step
    np.testing.assert_allclose(found[0], found[1], atol=0.01)


def test_shifts_are_smooth_near_to_what_is_wanted_and_nothing_at_keys():
    wanted = np.zeros((60, 3))
    wanted[10:25], wanted[26:40] = 0.1, -0.05  # from heel to toe: two places in neighbouring frames
    held, known = wanted[:, 0] != 0, np.zeros(60, bool)
    known[[0, 32, 59]] = True
    found = _smooth(wanted, held, known, 30.0)
    assert (found[known] == 0).all()
    np.testing.assert_allclose(found[14:21], 0.1, atol=0.01)  # in the middle of a stand
    assert np.abs(np.diff(found, n=3, axis=0)).max() < 0.25 * np.abs(np.diff(wanted, n=3, axis=0)).max()
    assert np.abs(found[[3, 55]]).max() < 0.04  # it dies away

    def cost(path: np.ndarray) -> float:
        """What `_smooth` makes least, written out."""
        weights = np.where(held, 1.0, LOOSE)[:, None]  # keys are nothing in all paths here
        target = np.where((held & ~known)[:, None], wanted, 0)
        bent = np.diff(path, n=2, axis=0)
        return float((weights * (path - target) ** 2).sum() + (SMOOTH_S * 30.0) ** 4 * (bent**2).sum())

    rng = np.random.default_rng(0)
    for _ in range(20):
        other = found + np.where(known[:, None], 0, 1e-3 * rng.normal(size=found.shape))
        assert cost(found) < cost(other)


@pytest.mark.parametrize("name", ["walk", "dance_a", "punch"])
def test_a_foot_that_the_leg_cannot_hold_is_let_go_without_a_pop(name: str):
    """The pelvis rises out of reach between keys 30 frames apart, and sways, while the feet stand."""
    skeleton, _, filled, known = interpolated(name, 30)
    keys = np.flatnonzero(known)
    phase = np.interp(np.arange(filled.frames), keys, np.arange(len(keys)))
    roots = filled.root_positions.copy()
    roots += (np.sin(np.pi * phase) ** 2)[:, None] * np.array([0.1, 0.12, 0.1], np.float32)
    loose = replace(filled, root_positions=roots)
    held = locked_motion(skeleton, loose, known)
    assert np.abs(held.rotations - loose.rotations).max() > 0.01  # something is held
    assert_no_pop_is_worse(skeleton, loose, held, known)


def assert_no_pop_is_worse(skeleton: Skeleton, loose: Motion, held: Motion, known: np.ndarray) -> None:
    """By the figures of `pumps evaluate`, on all joints, beyond what float32 rounds."""
    turns = [largest_turn_deg(motion.rotations[None], ~known)[0] for motion in (loose, held)]
    assert turns[1] <= turns[0] + np.degrees(ROUNDING)
    pushes = [largest_acceleration_mps2(positions_of(skeleton, m)[None], ~known)[0] for m in (loose, held)]
    assert pushes[1] <= pushes[0] + MODEL_FPS**2 * ROUNDING


@settings(max_examples=12, deadline=None)
@given(
    name=st.sampled_from(["walk", "dance_a", "punch", "run", "kick"]),
    step=st.integers(8, 40),
    sway=st.tuples(*[st.floats(-0.12, 0.12)] * 3),
    waves=st.integers(1, 3),
)
def test_no_pop_is_ever_worse_and_keys_never_change(name: str, step: int, sway: tuple[float, ...], waves: int):
    skeleton, _, filled, known = interpolated(name, step)
    keys = np.flatnonzero(known)
    phase = np.interp(np.arange(filled.frames), keys, np.arange(len(keys)))
    roots = filled.root_positions + (np.sin(waves * np.pi * phase) ** 2)[:, None] * np.array(sway, np.float32)
    loose = replace(filled, root_positions=roots.astype(np.float32))
    held = locked_motion(skeleton, loose, known)
    assert_no_pop_is_worse(skeleton, loose, held, known)
    for field in ("rotations", "root_positions", "tracks"):
        assert getattr(held, field)[known].tobytes() == getattr(loose, field)[known].tobytes()
    assert (held.root_positions == loose.root_positions).all()


def standing(frames: int = 61) -> tuple[Skeleton, Motion, np.ndarray]:
    """The walk's first frame for two seconds, its legs bent, and keys. An arm waves: legs may then move as fast."""
    skeleton, motion, _, _ = interpolated("walk", 15)
    pose = pose_of_motion(skeleton, motion.at(np.zeros(frames, int)))
    bend = np.radians(25)
    turns = torch.zeros(frames, len(skeleton.parents), 3)
    for hip, knee, ankle in limb_joints(skeleton, find_feet(skeleton)):
        for joint, angle in ((hip, -bend), (knee, 2 * bend), (ankle, -bend)):
            turns[:, joint, 0] = angle
    arm = int(np.flatnonzero(skeleton.groups == BODY_GROUPS.index("left_arm"))[0])
    turns[:, arm, 0] = torch.sin(torch.arange(frames) * 0.5)
    bent = pose.corrected(turns, torch.zeros(frames, 3)).motion(motion.fps)
    known = np.zeros(frames, bool)
    known[[0, 15, 45, 60]] = True
    return skeleton, bent, known


def test_a_planted_foot_stays_put_while_the_body_sways():
    skeleton, bent, known = standing()
    sway = np.where(known, 0, np.sin(np.linspace(0, 8 * np.pi, len(known))))[:, None] * np.array(
        [0.015, 0, 0.01], np.float32
    )
    loose = replace(bent, root_positions=(bent.root_positions + sway).astype(np.float32))
    feet = find_feet(skeleton)
    held = locked_motion(skeleton, loose, known)
    slid = [np.ptp(positions_of(skeleton, each)[:, feet.joints], axis=0).max() for each in (loose, held)]
    assert slid[0] > 0.02 and slid[1] < 0.4 * slid[0]
    assert_no_pop_is_worse(skeleton, loose, held, known)


def test_no_foot_comes_lower_than_in_the_keys():
    skeleton, bent, known = standing()
    feet = find_feet(skeleton)
    # Deepest midway between two keys, and no step beside them.
    keys = np.flatnonzero(known)
    phase = np.interp(np.arange(bent.frames), keys, np.arange(len(keys)))
    sunk = bent.root_positions.copy()
    sunk[:, 1] -= 0.04 * np.sin(np.pi * phase) ** 2
    loose = replace(bent, root_positions=sunk)
    locked = locked_motion(skeleton, loose, known)
    for kind in (False, True):
        joints = feet.joints[feet.is_end == kind]
        if len(joints):
            heights, before = (positions_of(skeleton, motion)[:, joints, 1] for motion in (locked, loose))
            floor = heights[known].min()
            assert before.min() < floor - 0.03
            assert heights.min() > floor - 0.01  # what the solve leaves
    assert (locked.rotations[known] == loose.rotations[known]).all()


def test_feet_that_float_come_down_but_not_in_flight():
    skeleton, bent, known = standing()
    feet = find_feet(skeleton)
    frames = np.arange(len(known))
    inside = (frames > 15) & (frames < 45)
    rise = np.where(inside, 0.12 * np.sin(np.pi * (frames - 15) / 30) ** 2, 0)
    loose = replace(
        bent,
        root_positions=(bent.root_positions + rise[:, None] * np.array([0, 1, 0], np.float32)).astype(np.float32),
    )
    heights = [
        positions_of(skeleton, each)[:, feet.joints, 1].min(1)
        for each in (bent, loose, locked_motion(skeleton, loose, known))
    ]
    floating = [(each - heights[0])[inside].mean() for each in heights]
    assert floating[1] > 0.05 and floating[2] < 0.5 * floating[1]
    # A ballistic rise of the same clip is a jump: nothing comes down.
    seconds = (frames - 15) / bent.fps
    jump = np.where(inside, 0.5 * 9.81 * seconds * (1 - seconds), 0)
    flying = replace(
        bent,
        root_positions=(bent.root_positions + jump[:, None] * np.array([0, 1, 0], np.float32)).astype(np.float32),
    )
    places = positions_of(skeleton, flying)
    contacts = standing_feet(places, feet, bent.fps, known)
    assert (lowered_feet(places, contacts, feet, skeleton.root, known, bent.fps)[20:40] == 0).all()


def test_contact_heights_are_those_of_low_keys_and_else_the_floor():
    skeleton, bent, known = standing()
    feet, places = find_feet(skeleton), positions_of(skeleton, bent).copy()
    places[45:, feet.joints, 1] += 0.02
    heights = contact_heights(places, feet, known)
    np.testing.assert_allclose(heights[known], places[known][:, feet.joints, 1], atol=1e-6)
    np.testing.assert_allclose(heights[30] - heights[15], 0.01, atol=1e-3)


@settings(max_examples=60, deadline=None)
@given(known=hnp.arrays(bool, st.integers(1, 300)), frames=st.integers(1, 60))
def test_pieces_cover_a_clip_once_and_meet_at_keys(known: np.ndarray, frames: int):
    known[0] = True
    pieces = _pieces(known, frames)
    assert pieces[0][0].start == 0 and pieces[-1][0].stop == len(known)
    for (own, around), (following, _) in pairwise([*pieces, pieces[-1]]):
        assert around.start <= own.start and own.stop <= around.stop
        if following is not own:
            assert following.start == own.stop - 1 and known[following.start]
