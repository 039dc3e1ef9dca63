"""Feet: found on any rig, standing where low and slow, and the skate is the speed that was put in."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.errors import InputError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.foot_contacts import (
    HEIGHT_SHARE,
    SPEED_SHARE,
    _long_runs,
    detect_contacts,
    find_feet,
    floor_levels,
    foot_skate_mps,
    low_feet,
)
from stages.shared.kinematics.forward import positions_of
from tests.shared.inference.examples import humanoid

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"


def clip(name: str):
    path = CLIPS / f"{name}.bvh"
    skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), str(path)))
    return skeleton, motion, positions_of(skeleton, motion)


def standing(frames: int = 60):
    """The synthetic humanoid's joints, still, its last leg joints 0.45 m below the pelvis."""
    skeleton = humanoid()
    positions = np.zeros((frames, skeleton.joints, 3))
    for joint, parent in enumerate(skeleton.parents):
        positions[:, joint] = skeleton.offsets[joint] + (positions[:, parent] if parent >= 0 else 0)
    return skeleton, find_feet(skeleton), positions


def test_feet_are_the_ends_of_the_legs():
    skeleton, feet, _ = standing()
    assert [skeleton.names[joint] for joint in feet.joints] == ["left_shin", "right_shin"]
    assert feet.leg_m == pytest.approx(0.45) and feet.is_end.all()
    assert feet.chains == ((8, 9), (10, 11))


def test_toes_and_ankles_where_a_rig_has_both():
    skeleton, _, _ = clip("walk")
    feet = find_feet(skeleton)
    assert 0.5 < feet.leg_m < 1.2
    assert set(feet.groups) == {3, 4} and feet.is_end.sum() == 2


def test_a_rig_without_legs_is_refused():
    skeleton = humanoid()
    with pytest.raises(InputError, match="two legs"):
        find_feet(replace(skeleton, groups=np.where(skeleton.groups >= 3, 0, skeleton.groups).astype(np.int8)))


def test_skate_is_the_speed_that_was_put_in():
    _, feet, positions = standing()
    speed = 0.5 * SPEED_SHARE * feet.leg_m
    positions[..., 0] += speed * np.arange(60)[:, None] / 30
    contacts = detect_contacts(positions, feet, 30.0)
    assert contacts.all()
    assert foot_skate_mps(positions, contacts, feet, 30.0) == pytest.approx(speed)
    assert foot_skate_mps(positions, low_feet(positions, feet), feet, 30.0) == pytest.approx(speed)
    positions[..., 0] += 2 * speed * np.arange(60)[:, None] / 30
    assert not detect_contacts(positions, feet, 30.0).any()
    assert np.isnan(foot_skate_mps(positions, detect_contacts(positions, feet, 30.0), feet, 30.0))


def test_a_lifted_foot_does_not_stand_and_a_blink_does_not_break_a_stand():
    _, feet, positions = standing()
    left = feet.joints[0]
    positions[20:40, left, 1] += 2 * HEIGHT_SHARE * feet.leg_m
    contacts = detect_contacts(positions, feet, 30.0)
    assert not contacts[20:40, 0].any() and contacts[:19, 0].all() and contacts[41:, 0].all()
    assert contacts[:, 1].all()
    _, feet, positions = standing()
    positions[30, left, 1] += 2 * HEIGHT_SHARE * feet.leg_m
    blink = detect_contacts(positions, feet, 30.0)
    assert blink[:29, 0].all() and blink[32:, 0].all() and not blink[30, 0]  # low is asked of every frame


def test_the_floor_is_that_of_the_known_frames():
    _, feet, positions = standing()
    known = np.zeros(60, bool)
    known[::15] = True
    junk = positions.copy()
    junk[~known] -= 50.0
    np.testing.assert_array_equal(floor_levels(junk, feet, known), floor_levels(positions, feet, known))


@pytest.mark.parametrize("name", ["walk", "run", "dance_a"])
def test_contacts_do_not_change_with_size_place_or_heading(name: str):
    skeleton, motion, positions = clip(name)
    feet = find_feet(skeleton)
    contacts = detect_contacts(positions, feet, motion.fps)
    large = find_feet(replace(skeleton, offsets=skeleton.offsets * 2.5))
    turn = np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]])
    moved = 2.5 * positions.astype(np.float64) @ turn + [3, -7, 5]
    assert (detect_contacts(moved, large, motion.fps) == contacts).mean() > 0.999
    skate = foot_skate_mps(positions, contacts, feet, motion.fps)
    assert foot_skate_mps(moved, contacts, large, motion.fps) == pytest.approx(2.5 * skate, rel=1e-3)


def test_a_walker_stands_on_one_foot_and_then_on_the_other():
    skeleton, motion, positions = clip("walk")
    feet = find_feet(skeleton)
    contacts = detect_contacts(positions, feet, motion.fps)
    left, right = (contacts[:, feet.groups == group].any(1) for group in (3, 4))
    assert (left & ~right).any() and (right & ~left).any()
    assert (left | right).mean() > 0.7
    assert foot_skate_mps(positions, contacts, feet, motion.fps) < 0.2


def _long_runs_plainly(flags: np.ndarray, least: int) -> np.ndarray:
    out = flags.copy()
    for column in range(flags.shape[1]):
        at = 0
        for value, run in itertools.groupby(flags[:, column].tolist()):
            length = len(list(run))
            if value and length < least and at > 0 and at + length < len(flags):
                out[at : at + length, column] = False
            at += length
    return out


@settings(max_examples=200, deadline=None)
@given(st.lists(st.lists(st.booleans(), min_size=2, max_size=2), min_size=1, max_size=30), st.integers(1, 6))
def test_short_runs_are_dropped_but_for_those_at_the_ends(rows: list[list[bool]], least: int) -> None:
    flags = np.array(rows)
    assert np.array_equal(_long_runs(flags, least), _long_runs_plainly(flags, least))
