"""Filling under constraints: what is given stays, what is not given is not read, ends stay where they are pinned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.constraints.asked import Constraints, PartFrames, Pin, RootPath
from stages.shared.inference.constraints.fixed import MOST_M, Fixed, fixed_of
from stages.shared.inference.constraints.flags import constraints_of_flags
from stages.shared.inference.constraints.known_parts import KnownParts, known_parts
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.models import load_weights
from stages.shared.kinematics.forward_numpy import global_rotations, local_rotations_of, positions_of
from stages.shared.kinematics.rotations import angles_between, rotate
from tests.shared.inference.examples import humanoid, swinging, write_random_weights

T, KEYS = 41, "0,20,40"


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> SynthesisedClouds:
    return SynthesisedClouds(load_weights(write_random_weights(tmp_path_factory.mktemp("weights")), "cpu"))


def fill(skeleton: Skeleton, motion: Motion, asked: Constraints, source, **options):
    parts = known_parts(asked, skeleton, motion.frames)
    given_motion, fixed, notes = fixed_of(asked, skeleton, motion, parts)
    made = fill_motion(
        skeleton, given_motion, parts.whole, source, points=48, options=FillOptions(**options), fixed=fixed
    )
    return made, parts, fixed, notes


def with_junk(skeleton: Skeleton, motion: Motion, parts: KnownParts) -> Motion:
    """Other values wherever nothing is given."""
    rng = np.random.default_rng(5)
    local = local_rotations_of(skeleton, motion)
    other = rng.normal(size=local.shape)
    other /= np.linalg.norm(other, axis=-1, keepdims=True)
    rotations = global_rotations(np.where(parts.joints[..., None], local, other), skeleton.parents)
    roots = np.where(parts.position[:, None], motion.root_positions, rng.normal(size=(motion.frames, 3)))
    return replace(motion, rotations=rotations.astype(np.float32), root_positions=roots.astype(np.float32))


@settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sets(st.sampled_from(["arms", "left_leg", "legs", "spine", "position", "head"]), min_size=1), st.integers(0, 9)
)
def test_what_is_kept_stays_and_nothing_else_is_read(source, kept, seed):
    skeleton = humanoid()
    motion = swinging(skeleton, T, seed=seed)
    asked = constraints_of_flags(KEYS, keep=[f"{part}:all" for part in sorted(kept)])
    made, parts, _, _ = fill(skeleton, motion, asked, source, foot_lock=True)
    apart = angles_between(local_rotations_of(skeleton, made.motion), local_rotations_of(skeleton, motion))
    assert apart[parts.joints].max() < 2e-3
    places = positions_of(skeleton, made.motion) - positions_of(skeleton, motion)
    assert np.abs(places[parts.position, skeleton.root]).max() < 1e-5
    keys = np.flatnonzero(parts.whole)
    assert np.array_equal(made.motion.rotations[keys], motion.rotations[keys])
    again, *_ = fill(skeleton, with_junk(skeleton, motion, parts), asked, source, foot_lock=True)
    # Rotations in the parents are computed from other global ones here: equal up to the rounding of float32.
    assert np.abs(positions_of(skeleton, again.motion) - positions_of(skeleton, made.motion)).max() < 2e-3


def test_keys_of_a_part_are_met_between_keys_of_the_body(source):
    skeleton = humanoid()
    motion = swinging(skeleton, T)
    made, parts, _, _ = fill(skeleton, motion, constraints_of_flags(f"{KEYS};arms=7,13,30"), source)
    apart = angles_between(local_rotations_of(skeleton, made.motion), local_rotations_of(skeleton, motion))
    assert apart[parts.joints].max() < 2e-3
    free = ~parts.joints & ~parts.whole[:, None]
    assert apart[free].mean() > 0.05  # random weights do not find the rest


def test_without_more_than_keys_nothing_changes(source):
    skeleton = humanoid()
    motion = swinging(skeleton, T)
    known = np.isin(np.arange(T), [0, 20, 40])
    plain = fill_motion(skeleton, motion, known, source, points=48)
    nothing = Fixed(np.zeros((T, skeleton.joints), bool), np.full((T, 3), np.nan))
    made = fill_motion(skeleton, motion, known, source, points=48, fixed=nothing)
    apart = positions_of(skeleton, made.motion) - positions_of(skeleton, plain.motion)
    assert np.abs(apart).max() < 1e-4


@pytest.mark.parametrize("above", [False, True])
def test_the_pelvis_follows_its_path(source, above):
    skeleton = humanoid(above=above)
    motion = swinging(skeleton, T)
    pelvis = positions_of(skeleton, motion)[:, skeleton.root]
    frames = (0, 10, 20, 30, 40)
    places = tuple((float(pelvis[f, 0]), float(pelvis[f, 2])) for f in frames)
    asked = Constraints(keyframes=KEYS, path=RootPath(frames=frames, places=places))
    made, _, fixed, notes = fill(skeleton, motion, asked, source)
    got = positions_of(skeleton, made.motion)[:, skeleton.root]
    assert notes == [] and np.abs(got[[10, 30]][:, [0, 2]] - pelvis[[10, 30]][:, [0, 2]]).max() < 1e-4
    assert np.nanmax(np.abs(got - fixed.pelvis)) < 1e-4
    with pytest.raises(InputError, match="key 20"):
        far = RootPath(frames=frames, places=(places[0], places[1], (9.0, 9.0), places[3], places[4]))
        fill(skeleton, motion, Constraints(keyframes=KEYS, path=far), source)
    with pytest.raises(InputError, match="frame 41"):
        fill(skeleton, motion, Constraints(keyframes=KEYS, path=RootPath(frames=(41,), places=((0, 0),))), source)
    with pytest.raises(InputError, match="contradict"):
        kept = (PartFrames(part="position", frames="5"),)
        fill(skeleton, motion, asked.model_copy(update={"keep": kept}), source)


def test_locked_joints_turn_from_key_to_key(source):
    skeleton = humanoid()
    motion = swinging(skeleton, T)
    head = skeleton.names.index("head")
    made, *_ = fill(skeleton, motion, constraints_of_flags(KEYS, locks=["head"]), source)
    local = local_rotations_of(skeleton, made.motion)[:, head]
    for first, last in ((0, 20), (20, 40)):
        whole = angles_between(local[first], local[last])
        steps = angles_between(local[first : last + 1], local[first])
        assert np.allclose(steps, np.linspace(0, whole, 21), atol=3e-3)


def end_places(skeleton: Skeleton, motion: Motion, joint: str, tail: bool = True) -> np.ndarray:
    index = skeleton.names.index(joint)
    own = np.tile(skeleton.tails[index] * tail, (motion.frames, 1))
    return positions_of(skeleton, motion)[:, index] + rotate(motion.rotations[:, index].astype(np.float64), own)


@settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 20), st.sampled_from(["left_hand", "right_hand", "head"]))
def test_a_pinned_end_stays_in_the_world(source, seed, end):
    skeleton = humanoid()
    motion = swinging(skeleton, T, seed=seed)
    made, parts, *_ = fill(skeleton, motion, constraints_of_flags(KEYS, pins=[f"{end}:23-37"]), source)
    places = end_places(skeleton, made.motion, end, tail=end != "head")[23:38]
    assert np.ptp(places, axis=0).max() < 0.005
    assert made.pins_off_m[end] < 0.005
    keys = np.flatnonzero(parts.whole)
    assert np.array_equal(made.motion.rotations[keys], motion.rotations[keys])


def test_a_pin_with_places_follows_them(source):
    skeleton = humanoid()
    motion = swinging(skeleton, T, seed=3)
    wanted = end_places(skeleton, motion, "left_hand")
    pin = Pin(end="left_hand", frames="all", places=tuple((float(x), float(y), float(z)) for x, y, z in wanted))
    made, *_ = fill(skeleton, motion, Constraints(keyframes="every:5", pins=(pin,)), source)
    assert np.linalg.norm(end_places(skeleton, made.motion, "left_hand") - wanted, axis=1).max() < 0.005


def test_pins_that_contradict(source):
    skeleton = humanoid()
    motion = swinging(skeleton, T)
    for flags, said in (
        ({"pins": ["left_hand:10-30"]}, "key [0-9]+ has it"),
        ({"pins": ["left_hand:3-5", "left_hand:5-8"]}, "twice in frame 5"),
        ({"pins": ["left_hand:3-5"], "keep": ["left_arm:all"]}, "kept or locked"),
        ({"pins": ["left_hand:3-5"], "locks": ["arms"]}, "kept or locked"),
        ({"pins": ["left_hand:3-50"]}, "3-50"),
    ):
        with pytest.raises(InputError, match=said):
            keys = "0,15,20,25,40" if said.startswith("key") else KEYS
            fill(skeleton, motion, constraints_of_flags(keys, **flags), source)
    with pytest.raises(UsageError, match="--path"):
        fill(skeleton, motion, constraints_of_flags(KEYS, pins=["pelvis:3-5"]), source)
    away = Pin(end="left_hand", frames="12", place=(50.0, 0.0, 0.0))
    with pytest.raises(InputError, match="cannot reach"):
        fill(
            skeleton, motion, Constraints(keyframes="every:5", keep=(PartFrames(part="root"),), pins=(away,)), source
        )


def test_keys_a_little_off_are_met_and_told(source):
    skeleton = humanoid()
    motion = swinging(skeleton, T, seed=3)
    own = end_places(skeleton, motion, "left_hand")
    place = own[20] + [0.007, 0.0, 0.0]
    pin = Pin(end="left_hand", frames="18-22", place=tuple(float(value) for value in place))
    made, _, _, notes = fill(skeleton, motion, Constraints(keyframes=KEYS, pins=(pin,)), source)
    assert len(notes) == 1 and "7.0 mm" in notes[0]
    assert 0.005 < made.pins_off_m["left_hand"] < MOST_M
    assert np.array_equal(made.motion.rotations[20], motion.rotations[20])
