"""The stage on a small artefact: rows, summary, determinism, protocols, errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import read_metrics
from data_schemas.motion import ClipRow, MotionWriter
from data_schemas.trainings import TrainedArchive, TrainingData
from stages.evaluate import methods
from stages.evaluate.config import Config
from stages.evaluate.methods import without_answers
from stages.evaluate.run import run
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.baselines import BASELINES, Poses
from stages.shared.statistics.measurements import (
    facing_turn,
    first_frame_of,
    hip_joints,
    measured_joints,
    position_deviation,
    turned_quaternions,
    turned_vectors,
)
from stages.shared.statistics.window_seeds import window_seed
from stages.shared.weights.shipped import named_source
from tests.evaluate.swaying import NAMES, skeleton, swaying
from tests.shared.inference.examples import write_random_weights


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("evaluate") / "motions"
    clips = [
        ("one", "set-1.zip!a/one.bvh", 300, 30.0, "test", 1.0),
        ("two", "set-1.zip!a/two.bvh", 125, 30.0, "test", 1.0),
        ("brief", "set-1.zip!a/brief.bvh", 60, 30.0, "test", 1.0),
        ("tiny", "set-1.zip!a/tiny.bvh", 30, 30.0, "test", 1.0),
        ("fast", "data/set-2/fast.bvh", 600, 120.0, "test", 0.7),
        ("seen", "set-1.zip!a/seen.bvh", 200, 30.0, "train", 1.0),
        ("other", "data/set-2/other.bvh", 150, 30.0, "val", 0.7),
    ]
    with (
        write_artefact(path, "motion", stage="ingest", config={}, licences=["a licence"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for seed, (clip, source, frames, fps, split, size) in enumerate(clips):
            name = writer.add_skeleton(skeleton(size))
            row = ClipRow(clip, source, "0" * 64, name, frames, fps, frames / fps, split, "a licence")
            writer.add_clip(row, swaying(seed, frames, fps))
    return path


def test_the_stage_writes_rows_and_a_summary(motions: Path, tmp_path: Path) -> None:
    config = Config(motion=motions, output=tmp_path / "metrics", max_windows=4)
    report = run(config)
    rows, summary = read_metrics(config.output)
    by_key = {(r.clip, r.task, r.interval, r.metric, r.method): r for r in rows}
    assert by_key["one", "interpolation", 15, "l2p_m", "slerp"].windows == 2
    assert by_key["brief", "interpolation", 15, "l2p_m", "slerp"].windows == 1
    assert ("brief", "transition", 60, "l2p_m", "slerp") not in by_key
    assert not any(row.clip in ("tiny", "seen") for row in rows)
    assert {row.archive for row in rows} == {"set-1", "set-2"}
    assert {row.clip for row in rows if row.archive == "set-2"} == {"fast", "other"}  # none of it was trained on
    errors = [by_key["one", "interpolation", i, "l2p_m", "slerp"].value for i in (5, 15, 30)]
    assert 0 < errors[0] < errors[1] < errors[2]
    assert by_key["one", "interpolation", 15, "l2p_m", "cubic"].value < errors[1]
    assert {r.method for r in rows if r.task == "prediction"} == {"zero-velocity", "constant-velocity", "truth"}
    largest = {"largest_turn_deg", "largest_acceleration_mps2", "crossing_frames"}
    own = {"key_jump_mps", "jerk_mps3", "twist_share", "jolt_share", *largest, *map(first_frame_of, largest)}
    assert {r.metric for r in rows if r.method == "truth"} == own  # it flies: nothing of standing feet
    worst = by_key["one", "interpolation", 15, "largest_turn_deg", "slerp"]
    start = by_key["one", "interpolation", 15, first_frame_of("largest_turn_deg"), "slerp"].value
    assert worst.value > 0 and 0 <= start == int(start)
    assert "### Pops" in summary and f"{worst.value:.1f} one {start:.0f}" in summary
    assert all(r.weight == 1 for r in rows if r.metric != "npss")
    assert "pumps evaluate --motion" in summary and "--max-windows 4" in summary and "windows of 3 clips" in summary
    assert report.figures["windows"]["set-1, interpolation 15"] == 4
    assert open_artefact(config.output).manifest.licences == ["a licence"]
    assert report.lines[0].startswith("Interpolation")


def test_the_same_config_gives_the_same_bytes(motions: Path, tmp_path: Path) -> None:
    digests = set()
    for _ in range(2):
        config = Config(motion=motions, output=tmp_path / "metrics", tasks=("interpolation",), intervals=(15,))
        run(config.model_copy(update={"overwrite": True}))
        digests.add(open_artefact(config.output).manifest.digest)
    assert len(digests) == 1


def test_the_solve_on_the_true_cloud_beats_slerp(motions: Path, tmp_path: Path) -> None:
    only = {"tasks": ("interpolation",), "intervals": (30,), "max_windows": 1}
    config = Config(motion=motions, output=tmp_path / "m", breakdown=True, **only)
    run(config)
    rows, _ = read_metrics(config.output)
    value = {(r.archive, r.method): r.value for r in rows if r.metric == "l2p_m"}
    assert value["set-1", methods.TRUE_CLOUD] < 0.6 * value["set-1", "slerp"]


def test_weights_are_methods_and_inputs(motions: Path, tmp_path: Path) -> None:
    folder = write_random_weights(tmp_path / "mine")
    only = {"tasks": ("interpolation", "prediction"), "intervals": (15,), "predictions": (15,), "max_windows": 1}
    config = Config(motion=motions, output=tmp_path / "m", weights=(str(folder),), breakdown=True, points=64, **only)
    run(config)
    rows, summary = read_metrics(config.output)
    assert {r.method for r in rows if r.task == "prediction"} >= {"mine", "mine-reconstructed", "zero-velocity"}
    assert all(np.isfinite(row.value) for row in rows)
    assert "- `mine`: weights" in summary
    shares = {r.method: r.value for r in rows if r.metric == "fell_back_share" and r.task == "interpolation"}
    assert set(shares) == {"mine", "mine-reconstructed", methods.TRUE_CLOUD} and all(
        0 <= s <= 1 for s in shares.values()
    )
    assert shares[methods.TRUE_CLOUD] < 0.1  # points without error are believed
    sections = summary.split("\n## ")[1:]
    assert [section.count("### Feel") for section in sections] == [1, 1, 1] and "Feel: mean" in summary
    assert [each.kind for each in open_artefact(config.output).manifest.inputs] == [
        "motion",
        "checkpoint",
        "checkpoint",
    ]


def test_archives_that_weights_were_trained_on_are_left_out(motions: Path, tmp_path: Path) -> None:
    archive, folder = TrainedArchive(name="set-1.zip"), TrainedArchive(name="renamed since", loose=True)
    for name, archives in (("zip", [archive]), ("loose", [folder]), ("both", [archive, folder])):
        data = TrainingData(clips=3, seconds=360.0, skeletons=1, archives=archives)
        write_random_weights(tmp_path / name, trained_on=data)
    write_random_weights(tmp_path / "silent")
    only = {"tasks": ("interpolation",), "intervals": (30,), "points": 32, "unseen": True}

    def clips(*names: str) -> set[str]:
        weights = tuple(f"{name}={tmp_path / name}" for name in names)
        run(Config(motion=motions, output=tmp_path / "m", weights=weights, overwrite=True, **only))
        return {row.clip for row in read_metrics(tmp_path / "m")[0]}

    assert clips("zip") == {"fast", "other"}
    assert clips("loose") == {"one", "two", "brief", "seen"}  # every split, all that is long enough
    assert "all clips of archives that none of the weights were trained on" in read_metrics(tmp_path / "m")[1]
    for names in (("both",), ("zip", "loose")):
        with pytest.raises(InputError, match="trained on clips of every archive"):
            clips(*names)
    with pytest.raises(InputError, match="silent do not say what they were trained on"):
        clips("silent")


def test_feet_are_held_as_infill_holds_them(motions: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, asked = write_random_weights(tmp_path / "mine"), []
    fill = methods.fill_motion

    def watched(*arguments, options, **others):
        asked.append((type(arguments[3]).__name__, bool(options and options.foot_lock)))
        return fill(*arguments, options=options, **others)

    monkeypatch.setattr(methods, "fill_motion", watched)
    only = {"tasks": ("interpolation",), "intervals": (30,), "max_windows": 1, "points": 32, "breakdown": True}
    run(Config(motion=motions, output=tmp_path / "m", weights=(str(folder),), **only))
    assert set(asked) == {("SynthesisedClouds", True), ("ReconstructedClouds", False), ("TrueClouds", False)}


def test_the_lafan1_protocol_names_its_own_figures(motions: Path, tmp_path: Path) -> None:
    only = {"tasks": ("transition",), "transitions": (5, 15)}
    config = Config(motion=motions, output=tmp_path / "m", protocol="lafan1", **only)
    run(config)
    rows, summary = read_metrics(config.output)
    assert {row.metric for row in rows} == {"l2p_lafan1", "l2q_lafan1", "npss_lafan1"}
    assert all(np.isfinite(row.value) for row in rows)
    assert "the LaFAN1 statistics are those of their measured clips" in summary  # set-2 has no training clip


def test_clear_errors(motions: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no clip of the split nothing"):
        run(Config(motion=motions, output=tmp_path / "m", splits=("nothing",)))
    with pytest.raises(InputError, match="long enough"):
        run(Config(motion=motions, output=tmp_path / "m", tasks=("transition",), transitions=(900,)))
    with pytest.raises(ValidationError, match="must name some of"):
        Config(motion=motions, output=tmp_path / "m", tasks=("filling",))
    with pytest.raises(ValidationError, match="1 or more"):
        Config(motion=motions, output=tmp_path / "m", intervals=(0,))
    with pytest.raises(UsageError, match="Two methods are called 'slerp'"):
        run(Config(motion=motions, output=tmp_path / "m", weights=("slerp=nowhere",)))
    with pytest.raises(UsageError, match="NAME=FOLDER"):
        named_source("=x")
    assert not (tmp_path / "m").exists()


def test_rows_that_are_not_known_are_junk_before_a_model_sees_them() -> None:
    motion = swaying(0, 40)
    known = np.arange(40) % 10 == 0
    given = without_answers(motion, known)
    np.testing.assert_array_equal(given.rotations[known], motion.rotations[known])
    np.testing.assert_array_equal(given.tracks[known], motion.tracks[known])
    assert (given.rotations[~known] == [0, 0, 0, 1]).all() and (given.tracks[~known] == 0).all()
    assert motion.rotations[1, 2, 0] != 0


def test_window_seeds_differ_by_window_and_repeat() -> None:
    seeds = [window_seed(0, clip, start) for clip in "ab" for start in (0, 121)]
    assert len(set(seeds)) == 4
    assert window_seed(0, "a", 0) == seeds[0]
    assert window_seed(1, "a", 0) != seeds[0]


@pytest.mark.parametrize(
    ("source", "archive"),
    [("x/bandai.zip!a/b.bvh", "bandai"), ("data/cmu/a.bvh", "cmu"), ("a.bvh", "files"), ("C:\\d\\e\\f.bvh", "e")],
)
def test_archives_are_named_by_where_a_clip_is_from(source: str, archive: str) -> None:
    row = ClipRow("c", source, "0" * 64, "s", 10, 30.0, 0.3, "test", "")
    assert archive_of(row) == archive


def test_passthrough_and_zero_length_joints_do_not_count() -> None:
    assert [NAMES[j] for j in measured_joints(skeleton())] == list(NAMES[1:8])
    assert [NAMES[j] for j in hip_joints(skeleton())] == ["leg.L", "leg.R"]


def test_facing_is_undone() -> None:
    poses = Poses.of(skeleton(), [swaying(1, 20)])
    positions, rotations = poses.positions.numpy(), poses.rotations.numpy()
    across = hip_joints(skeleton())
    straight = turned_vectors(facing_turn(positions[:, 5], across), positions)
    hips = straight[0, 5, across[0]] - straight[0, 5, across[1]]
    assert hips[2] == pytest.approx(0, abs=1e-6) and hips[0] > 0
    for angle in (0.4, 2.0, -3.0):
        turn = Rotation.from_rotvec([[0, angle, 0]])
        turned, spun = turned_vectors(turn, positions), turned_quaternions(turn, rotations)
        again = facing_turn(turned[:, 5], across)
        np.testing.assert_allclose(turned_vectors(again, turned), straight, atol=1e-6)
        both = turned_quaternions(again, spun)
        first = turned_quaternions(facing_turn(positions[:, 5], across), rotations)
        np.testing.assert_allclose(np.abs((both * first).sum(-1)), 1, atol=1e-6)


def test_training_deviations_do_not_depend_on_place_or_heading() -> None:
    poses = Poses.of(skeleton(), [swaying(s, 50) for s in range(4)])
    positions, joints, across = poses.positions.numpy(), measured_joints(skeleton()), hip_joints(skeleton())
    deviation = position_deviation(positions, joints, across, 1)
    turn = Rotation.from_rotvec(np.array([0.3, -2, 1, 3])[:, None] * [0, 1, 0])
    moved = turned_vectors(turn, positions) + np.arange(4)[:, None, None, None] * [3.0, 0, -2]
    np.testing.assert_allclose(position_deviation(moved, joints, across, 1), deviation, atol=1e-5)
    assert deviation.shape == (7, 3) and (deviation > 0).all()


def test_methods_see_the_truth_of_their_keys_only() -> None:
    poses = Poses.of(skeleton(), [swaying(2, 61)])
    known = np.arange(61) % 15 == 0
    blind = Poses.of(skeleton(), [replace(without_answers(swaying(2, 61), known))])
    for fill in BASELINES.values():
        np.testing.assert_array_equal(fill(poses, known)[0], fill(blind, known)[0])
