"""Filling on real motion capture: the solve on true clouds against slerp, and infill on files of two rigs."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_schemas.skeleton import Motion, Skeleton
from stages.infill.config import Config
from stages.infill.run import run
from stages.measure.solve.conditions import TRUE, conditions_of
from stages.measure.solve.config import Config as MeasureConfig
from stages.measure.solve.measurements import measurements_of
from stages.measure.solve.methods import slerp as slerp_of
from stages.measure.solve.methods import solve
from stages.measure.solve.rigs import Rigged
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.inference.cloud_sources import TrueClouds
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.kinematics.foot_contacts import detect_contacts, find_feet, foot_skate_mps
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.resampling import resample
from tests.shared.inference.examples import write_random_weights

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SALSA_FPS = 60.0  # the files say 120
WINDOWS = 4

pytestmark = [pytest.mark.real, pytest.mark.skipif(not DATA.is_dir(), reason="no real motion capture here")]


def windows_of(archive: str) -> list[tuple[Skeleton, Motion]]:
    """121-frame windows at 30 fps of the archive's first test clips that are long enough."""
    fps = SALSA_FPS if archive.startswith("cmu") else None
    members = json.loads((DATA / "splits.json").read_text())[archive]["test"]
    windows: list[tuple[Skeleton, Motion]] = []
    with zipfile.ZipFile(DATA / archive) as bundle:
        for member in members:
            if len(windows) == WINDOWS:
                break
            skeleton, motion, _ = motion_of(
                read_bvh(bundle.read(member), member), fps_override=fps, trim_first="auto"
            )
            motion = resample(motion, 30.0)
            if motion.frames >= 121:
                start = (motion.frames - 121) // 2
                windows.append((skeleton, motion.at(np.arange(start, start + 121))))
    return windows


def l2p_m(skeleton: Skeleton, motion: Motion, truth: Motion) -> float:
    away = (positions_of(skeleton, motion) - positions_of(skeleton, truth))[:, skeleton.groups >= 0]
    return float(np.sqrt((away**2).sum((-1, -2))).mean())


@pytest.mark.parametrize("archive", ["bandai-namco-1.zip", "cmu-dance.zip", "lafan1-g1.zip"])
@pytest.mark.parametrize("step", [15, 30])
def test_solve_on_true_clouds_beats_slerp_by_far(archive: str, step: int):
    known = np.zeros(121, bool)
    known[::step] = True
    slerp = FillOptions(trust=0.0, base_smooth=0.0, ease_s=0.0)
    made, plain = [], []
    for seed, (skeleton, motion) in enumerate(windows_of(archive)):
        made.append(
            l2p_m(skeleton, fill_motion(skeleton, motion, known, TrueClouds(motion), seed=seed).motion, motion)
        )
        base = fill_motion(skeleton, motion, known, TrueClouds(motion), seed=seed, options=slerp)
        plain.append(l2p_m(skeleton, base.motion, motion))
    assert np.mean(made) < 0.1 * np.mean(plain)
    assert max(a / b for a, b in zip(made, plain, strict=True)) < 0.25


@pytest.mark.parametrize("archive", ["bandai-namco-1.zip", "cmu-dance.zip", "lafan1-g1.zip"])
def test_a_cloud_is_followed_to_under_a_millimetre_by_keys_and_to_a_centimetre_by_one(archive: str):
    by_keys, by_one, plain = [], [], []
    for skeleton, motion in windows_of(archive)[:3]:
        truth = Rigged(skeleton, motion)
        config = MeasureConfig(motion=DATA, output=DATA)
        for condition in conditions_of(config):
            if condition.name in (TRUE, "one key") and condition.interval != 30:
                case = condition.make(truth, np.random.default_rng(0))
                figures = measurements_of(skeleton, motion, solve(case))
                (by_one if condition.name == "one key" else by_keys).append(figures)
                if condition.name == TRUE:
                    plain.append(measurements_of(skeleton, motion, slerp_of(case)))
    assert max(figures["mpjpe_mm"] for figures in by_keys) < 2 and np.mean([f["mpjpe_mm"] for f in by_keys]) < 1
    assert np.mean([f["l2q"] for f in by_keys]) < 0.15 * np.mean([f["l2q"] for f in plain])
    assert all(0.9 < figures["jerk_ratio"] < 1.1 for figures in by_keys)
    assert np.mean([figures["mpjpe_mm"] for figures in by_one]) < 10


@pytest.mark.parametrize("archive", ["bandai-namco-1.zip", "cmu-dance.zip", "lafan1-g1.zip"])
def test_held_feet_slide_less_and_nothing_pops(archive: str):
    slides, held, known = [], [], np.zeros(121, bool)
    known[::15] = True
    for skeleton, motion in windows_of(archive):
        options = FillOptions(trust=0.0)
        loose = fill_motion(skeleton, motion, known, TrueClouds(motion), options=options)
        locked = fill_motion(skeleton, motion, known, TrueClouds(motion), options=replace(options, foot_lock=True))
        feet, places = find_feet(skeleton), positions_of(skeleton, motion)
        stands = detect_contacts(places, feet, motion.fps)  # while the true feet stand
        slides.append(foot_skate_mps(positions_of(skeleton, loose.motion), stands, feet, motion.fps))
        held.append(foot_skate_mps(positions_of(skeleton, locked.motion), stands, feet, motion.fps))
        for field in ("rotations", "root_positions", "tracks"):
            ours, theirs = getattr(locked.motion, field), getattr(motion, field)
            assert len(theirs.ravel()) == 0 or (ours[known] == theirs[known]).all()
        third = [np.abs(np.diff(positions_of(skeleton, m), n=3, axis=0)).max() for m in (locked.motion, motion)]
        assert third[0] < 1.5 * third[1]
        assert l2p_m(skeleton, locked.motion, motion) < 1.01 * l2p_m(skeleton, loose.motion, motion)
    share = np.array(held) / np.array(slides)
    assert np.nanmax(share) < 1.02 and np.nanmedian(share) < 0.85


@pytest.mark.parametrize(
    ("archive", "member", "keys", "step"),
    [
        ("cmu-dance.zip", "cmu-dance/indian/06.bvh", "every:60", 60),
        ("bandai-namco-2.zip", "bandai-namco-2/dataset-2_raise-up-both-hands_active_020.bvh", "every:15", 15),
        ("lafan1-g1.zip", "lafan1-g1/walk3_subject4.bvh", "0:400:20", 20),
    ],
)
def test_infilled_files_keep_header_and_keys_and_open_elsewhere(archive, member, keys, step, tmp_path):
    bvh_module = pytest.importorskip("pymotion.io.bvh")
    source, output = tmp_path / "in.bvh", tmp_path / "out.bvh"
    with zipfile.ZipFile(DATA / archive) as bundle:
        source.write_bytes(bundle.read(member))
    weights = write_random_weights(tmp_path / "weights")
    run(Config(input=source, output=output, keyframes=keys, weights=str(weights), device="cpu", points=64))
    before, after = source.read_bytes(), output.read_bytes()
    cut = before.index(b"MOTION")
    assert after[:cut] == before[:cut]
    old, new = read_bvh(before, "in"), read_bvh(after, "out")
    assert new.frames == old.frames and new.motion_head == old.motion_head
    last = 380 if keys.startswith("0:") else old.frames - 1
    assert all(new.rows[k] == old.rows[k] for k in [*range(0, last + 1, step), *range(last, old.frames)])
    theirs = bvh_module.BVH()
    theirs.load(str(output))
    assert len(theirs.data["names"]) == len(old.joints) and len(theirs.data["rotations"]) == old.frames
