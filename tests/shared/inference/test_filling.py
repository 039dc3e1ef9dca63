"""Filling: keys exact, nothing leaks from between, true clouds give the motion back, odd rates, long clips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion
from stages.shared.inference.cloud_sources import GivenLatents, ReconstructedClouds, SynthesisedClouds, TrueClouds
from stages.shared.inference.clouds import place_on_pose
from stages.shared.inference.confidence import SHAPE, Confidence
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.models import load_weights
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.drawn_points import spread_on_skeleton
from stages.shared.solve.skeleton_pose import pose_of_motion
from stages.shared.solve.solving import SolveOptions
from tests.shared.inference.examples import humanoid, swinging, write_random_weights
from tests.shared.inference.keyed_motions import junk, keys_every


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    return load_weights(write_random_weights(tmp_path_factory.mktemp("weights")), "cpu")


@pytest.fixture(scope="module")
def source(models):
    return SynthesisedClouds(models)


def error_of(skeleton, motion: Motion, truth: Motion) -> float:
    away = (positions_of(skeleton, motion) - positions_of(skeleton, truth))[:, skeleton.groups >= 0]
    return float(np.sqrt((away**2).sum((-1, -2))).mean())


@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("step", [15, 30])
def test_true_cloud_gives_the_motion_back(above: bool, step: int):
    skeleton = humanoid(above=above)
    motion = swinging(skeleton, 121)
    known = keys_every(121, step)
    filled = fill_motion(skeleton, motion, known, TrueClouds(motion))
    slerp = FillOptions(trust=0.0, base_smooth=0.0, ease_s=0.0)
    plain = fill_motion(skeleton, motion, known, TrueClouds(motion), options=slerp)
    # The finger is seen by no point and stays with the plain interpolation: it bounds what can be won here.
    seen = skeleton.sampled | (skeleton.groups < 0)
    only = replace(skeleton, groups=np.where(seen, skeleton.groups, -1).astype(np.int8))
    assert error_of(only, filled.motion, motion) < 0.1 * error_of(only, plain.motion, motion)
    assert (filled.motion.rotations[known] == motion.rotations[known]).all()
    assert (filled.motion.root_positions[known] == motion.root_positions[known]).all()
    finger = skeleton.names.index("left_finger")
    assert filled.plain[~known][:, finger].all() and not filled.plain[known].any()
    assert not filled.plain[:, skeleton.root :][:, [i for i in range(12) if i != finger - skeleton.root]].any()


@pytest.mark.parametrize("fps", [30.0, 120.0, 100.0, 24.0])
def test_reads_the_keys_alone_and_gives_them_back(source, fps: float):
    skeleton = humanoid(above=True)
    frames = int(2 * fps) + 3
    motion = swinging(skeleton, frames, fps)
    known = keys_every(frames, int(fps / 2))
    first = fill_motion(skeleton, junk(motion, known), known, source, points=64)
    again = fill_motion(skeleton, motion, known, source, points=64)
    for name in ("rotations", "root_positions", "tracks"):
        assert getattr(first.motion, name).tobytes() == getattr(again.motion, name).tobytes()
        assert (getattr(first.motion, name)[known] == getattr(motion, name)[known]).all()
    assert first.motion.frames == frames and first.motion.fps == fps
    norms = np.linalg.norm(first.motion.rotations, axis=-1)
    np.testing.assert_allclose(norms, 1.0, atol=1e-5)
    assert len(first.jump_frames) == len(first.jumps_mps) == known[1:-1].sum()


def test_models_move_the_result_and_trust_scales_it(source):
    skeleton, known = humanoid(), keys_every(61, 15)
    motion = swinging(skeleton, 61)
    base = fill_motion(skeleton, motion, known, source, points=64, options=FillOptions(trust=0.0))
    full = fill_motion(skeleton, motion, known, source, points=64)
    half = fill_motion(skeleton, motion, known, source, points=64, options=FillOptions(trust=0.5))
    whole = error_of(skeleton, full.motion, base.motion)
    assert whole > 1e-3
    assert 0.3 * whole < error_of(skeleton, half.motion, base.motion) < 0.7 * whole


def test_seeds_decide_the_result(source):
    skeleton, known = humanoid(), keys_every(31, 15)
    motion = swinging(skeleton, 31)
    one, two, same = (fill_motion(skeleton, motion, known, source, points=64, seed=s) for s in (1, 2, 1))
    assert one.motion.rotations.tobytes() == same.motion.rotations.tobytes() != two.motion.rotations.tobytes()


def test_prediction_and_a_single_key(source):
    skeleton = humanoid()
    motion = swinging(skeleton, 60)
    for keys in (slice(0, 40), slice(0, 1), slice(20, 40)):
        known = np.zeros(60, bool)
        known[keys] = True
        filled = fill_motion(skeleton, junk(motion, known), known, source, points=64)
        assert np.isfinite(filled.motion.rotations).all() and np.isfinite(filled.motion.root_positions).all()
        assert (filled.motion.rotations[known] == motion.rotations[known]).all()


def test_all_known_is_left_alone_and_what_makes_no_sense_is_refused(models, source):
    skeleton = humanoid()
    motion = swinging(skeleton, 20)
    assert fill_motion(skeleton, motion, np.ones(20, bool), source).motion is motion
    known = keys_every(20, 5)
    with pytest.raises(InputError):
        fill_motion(skeleton, motion, np.zeros(20, bool), source)
    with pytest.raises(UsageError):
        fill_motion(skeleton, motion, known[:-1], source)
    few = GivenLatents(models.autoencoder, torch.zeros(19, 4), torch.zeros(19, 3))
    with pytest.raises(UsageError, match="19 latents do not fit"):
        fill_motion(skeleton, motion, known, few)
    with pytest.raises(InputError):
        fill_motion(replace(skeleton, sampled=np.zeros(12, bool)), motion, known, source)


def test_latents_given_are_decoded(models):
    """The true cloud's latents, handed in, give what `reconstructed` finds by itself."""
    skeleton, known = humanoid(), keys_every(40, 13)
    motion = swinging(skeleton, 40)

    drawn = spread_on_skeleton(skeleton, models.autoencoder.points, 0.5, 0.05)
    points = place_on_pose(drawn, pose_of_motion(skeleton, motion), skeleton)
    latents = models.encode(points, drawn.groups)
    one = FillOptions(views=1)
    given = fill_motion(
        skeleton,
        junk(motion, known),
        known,
        GivenLatents(models.autoencoder, *latents),
        points=64,
        seed=3,
        options=one,
    )
    found = fill_motion(skeleton, motion, known, ReconstructedClouds(models, motion), points=64, seed=3, options=one)
    np.testing.assert_allclose(given.motion.rotations, found.motion.rotations, atol=1e-3)


def test_a_gap_that_cannot_be_followed_falls_back(models, source):
    skeleton, known = humanoid(), keys_every(31, 10)
    motion = swinging(skeleton, 31)
    options = FillOptions(give_up_m=0.0, base_smooth=0.0, views=1, ease_s=0.0)
    filled = fill_motion(skeleton, motion, known, source, points=64, options=options)
    assert filled.plain[~known].all()
    wary = replace(models, confidence=Confidence(np.zeros(SHAPE)))
    plain = fill_motion(
        skeleton, motion, known, SynthesisedClouds(wary), points=64, options=replace(options, give_up_m=1.0)
    )
    np.testing.assert_allclose(filled.motion.rotations, plain.motion.rotations, atol=1e-6)
    base = fill_motion(skeleton, motion, known, source, points=64, options=replace(options, trust=0.0)).motion
    bends = [np.square(np.diff(positions_of(skeleton, each), n=2, axis=0)).sum() for each in (plain.motion, base)]
    assert bends[0] < bends[1]  # smooth all the same: slerp's corners at the keys are rounded


def test_corrections_reach_the_clips_own_frames_without_kinks():
    """At 120 fps the true motion comes back between the 30 fps tokens too."""
    skeleton = humanoid()
    motion = swinging(skeleton, 361, 120.0)
    known = keys_every(361, 60)
    filled = fill_motion(skeleton, motion, known, TrueClouds(motion))
    body = skeleton.sampled
    away = (positions_of(skeleton, filled.motion) - positions_of(skeleton, motion))[:, body]
    assert np.linalg.norm(away, axis=-1).mean() < 0.004
    truth = np.linalg.norm(np.diff(positions_of(skeleton, motion)[:, body], 2, axis=0), axis=-1)
    made = np.linalg.norm(np.diff(positions_of(skeleton, filled.motion)[:, body], 2, axis=0), axis=-1)
    assert made.mean() < 2 * truth.mean() + 1e-4


def test_long_clips_are_filled_in_parts_alike():
    """Chunks of the solve and of the cloud leave no seam: a long clip equals its beginning filled alone."""
    skeleton = humanoid()
    motion = swinging(skeleton, 1201)
    short = replace(motion, rotations=motion.rotations[:1051], root_positions=motion.root_positions[:1051])
    options = FillOptions(solve=SolveOptions(iterations=4))
    filled = [
        fill_motion(skeleton, m, keys_every(m.frames, 30), TrueClouds(m), points=64, options=options)
        for m in (motion, short)
    ]
    a, b = (positions_of(skeleton, f.motion) for f in filled)
    assert np.abs(a[:1000] - b[:1000]).max() < 0.01


def test_threads_and_tensors_stay_as_they_were(source):
    before = torch.get_num_threads(), torch.random.get_rng_state()
    skeleton, known = humanoid(), keys_every(20, 10)
    fill_motion(skeleton, swinging(skeleton, 20), known, source, points=32)
    assert before[0] == torch.get_num_threads() and torch.equal(before[1], torch.random.get_rng_state())


def test_small_corrections_are_not_believed(source):
    """Below the floor a joint stays plain and says so; above it little is lost."""
    skeleton, known = humanoid(), keys_every(61, 15)
    motion = swinging(skeleton, 61)
    believing = FillOptions(views=1, turn_floor_rad=0.0, shift_floor_m=0.0, smooth_span=0.0)
    deaf = replace(believing, turn_floor_rad=10.0, shift_floor_m=10.0)
    full = fill_motion(skeleton, motion, known, source, points=64, options=believing)
    none = fill_motion(skeleton, motion, known, source, points=64, options=deaf)
    base = fill_motion(skeleton, motion, known, source, points=64, options=replace(believing, trust=0.0))
    np.testing.assert_allclose(none.motion.rotations, base.motion.rotations, atol=1e-6)
    assert none.plain[~known].all() and not full.plain[~known].all()


def test_noise_does_not_turn_a_joint_that_never_turned_over_the_keys():
    """An elbow bends between keys, by as much as a noisy cloud might say of any: it is believed where the elbow bends
    over the keys, too, and hardly where it never does."""
    skeleton, known = humanoid(), keys_every(121, 8)
    motion = swinging(skeleton, 121)
    hand, arm = skeleton.names.index("left_hand"), skeleton.names.index("left_arm")
    frames = np.arange(121)
    bump = 0.1 * np.sin(np.pi * frames / 8) ** 2
    options = FillOptions(turn_floor_rad=0.0, shift_floor_m=0.0, smooth_span=0.0, ease_s=0.0)

    def followed(over_the_keys: np.ndarray) -> float:
        bends = Rotation.from_rotvec(np.outer(bump + over_the_keys, [0, 0, 1]))
        rotations = np.array(motion.rotations)
        rotations[:, hand] = (Rotation.from_quat(rotations[:, arm]) * bends).as_quat()
        given = replace(motion, rotations=rotations)
        angles = []
        for trust in (1.0, 0.0):
            made = fill_motion(skeleton, given, known, TrueClouds(given), options=replace(options, trust=trust))
            own = [Rotation.from_quat(made.motion.rotations[~known][:, joint]) for joint in (arm, hand)]
            angles.append((own[0].inv() * own[1]).as_rotvec()[:, 2])
        return float((angles[0] - angles[1]).mean() / bump[~known].mean())

    assert followed(np.zeros(121)) < 0.6 * followed(0.5 * np.sin(frames / 9))
