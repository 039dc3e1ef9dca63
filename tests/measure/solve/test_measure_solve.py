"""The stage on the embedded walk: rows and page, the same bytes again, conditions that do what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import read_metrics
from data_schemas.motion import ClipRow, MotionReader, MotionWriter
from stages.measure.solve.conditions import TRUE, conditions_of, known_every
from stages.measure.solve.config import CONDITIONS, Config
from stages.measure.solve.kept import keep_motions
from stages.measure.solve.methods import Method
from stages.measure.solve.rigs import Rigged
from stages.measure.solve.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from tests.shared.inference.examples import humanoid, swinging

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("solve") / "motions"
    with (
        write_artefact(path, "motion", stage="ingest", config={}, licences=["a licence"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for clip, split in (("walk", "test"), ("run", "train")):
            file = CLIPS / f"{clip}.bvh"
            skeleton, motion, _ = motion_of(read_bvh(file.read_bytes(), str(file)))
            row = ClipRow(clip, f"clips/{clip}.bvh", "0" * 64, writer.add_skeleton(skeleton), motion.frames,
                          motion.fps, motion.frames / motion.fps, split, "a licence")  # fmt: skip
            writer.add_clip(row, motion)
    return path


def test_true_clouds_noise_and_stranger_rigs_on_a_real_clip(motions: Path, tmp_path: Path):
    config = Config(
        motion=motions, output=tmp_path / "m", intervals=(15,), conditions=("true", "noise", "keys"), points=128,
        condition_seconds=2.0,
    )  # fmt: skip
    report = run(config)
    rows, page = read_metrics(config.output)
    figures = {(r.task, r.method, r.metric): r.value for r in rows}
    assert {r.clip for r in rows} == {"walk"} and {r.archive for r in rows} == {"clips"}
    assert figures[TRUE, "solve", "mpjpe_mm"] < 2 < figures[TRUE, "slerp", "mpjpe_mm"]
    assert figures[TRUE, "solve", "l2q"] < 0.2 * figures[TRUE, "slerp", "l2q"]
    assert figures[TRUE, "solve", "jerk_ratio"] == pytest.approx(1, abs=0.05)
    assert figures[TRUE, "solve", "skate_mps"] == pytest.approx(figures[TRUE, "truth", "skate_mps"], abs=0.02)
    assert figures["noise 60 mm", "solve", "mpjpe_mm"] > figures["noise 10 mm", "solve", "mpjpe_mm"]
    assert figures["one key", "solve", "mpjpe_mm"] < 10 < figures["one key", "slerp", "mpjpe_mm"]
    assert "## True clouds" in page and "| noise 30 mm | 15 |" in page and "first alone" in page
    assert page.count("noise 30 mm") == 1 and "all archives" not in page  # there is one archive
    worse = [line for line in report.lines if line.startswith("noise 30 mm")]
    assert len(worse) == 1 and ", solve: " in worse[0]
    assert report.figures["frames_per_s"]["solve"] > 0 and report.figures["clips"] == {"clips": 1}
    assert open_artefact(config.output).manifest.licences == ["a licence"]


def test_the_same_config_gives_the_same_bytes(motions: Path, tmp_path: Path):
    digests = set()
    for _ in range(2):
        config = Config(motion=motions, output=tmp_path / "x", conditions=("scales",), condition_seconds=1.6)
        run(config.model_copy(update={"points": 64, "overwrite": True}))
        digests.add(open_artefact(config.output).manifest.digest)

    assert len(digests) == 1


def test_every_condition_makes_a_case_that_fits(tmp_path: Path):
    config = Config(motion=tmp_path, output=tmp_path, points=64)
    skeleton = humanoid(above=True)
    truth = Rigged(skeleton, swinging(skeleton, 50))
    names = []
    for condition in conditions_of(config):
        case = condition.make(truth, np.random.default_rng(0))
        assert case.points.shape == (50, len(case.groups), 3) and case.known.shape == (50,)
        assert case.motion.rotations.shape[1] == case.skeleton.joints
        names.append((condition.name, condition.interval))
    assert len(set(names)) == len(names) > 20
    assert known_every(31, 15).nonzero()[0].tolist() == [0, 15, 30]
    assert known_every(31, 0).nonzero()[0].tolist() == [0]


def test_what_cannot_be_is_refused(motions: Path, tmp_path: Path):
    with pytest.raises(ValidationError, match="must name some of"):
        Config(motion=motions, output=tmp_path, conditions=("rain",))
    with pytest.raises(ValidationError, match="1 or more"):
        Config(motion=motions, output=tmp_path, intervals=(0,))
    with pytest.raises(InputError, match="no clip of the split val"):
        run(Config(motion=motions, output=tmp_path / "x", splits=("val",)))
    with pytest.raises(UsageError, match="NAME=FOLDER"):
        run(Config(motion=motions, output=tmp_path / "x", networks=("slerp=somewhere",)))
    assert CONDITIONS[0] == "true"


def test_folders_of_kept_motions_have_names_that_make_can_take(motions: Path, tmp_path: Path):
    config = Config(motion=motions, output=tmp_path / "m", conditions=("true",), points=64, condition_seconds=1.6)
    stands = Method("network and solve", lambda case: case.motion)
    with MotionReader(motions) as reader:
        row = reader.clips[0]
        keep_motions(reader, {"clips": [row]}, conditions_of(config)[0], [stands], config, tmp_path / "made", [])
    assert sorted(path.name for path in (tmp_path / "made" / "clips").iterdir()) == ["network-and-solve", "truth"]


def test_kept_motions_can_be_played(motions: Path, tmp_path: Path):
    config = Config(motion=motions, output=tmp_path / "m", intervals=(30,), conditions=("true",), points=64,
                    condition_seconds=1.6, made=tmp_path / "made")  # fmt: skip
    run(config)
    names = sorted(path.name for path in (tmp_path / "made" / "clips").iterdir())
    assert names == ["slerp", "solve", "truth"]
    kept = {name: MotionReader(tmp_path / "made" / "clips" / name) for name in names}
    assert {reader.clips[0].clip for reader in kept.values()} == {"walk"}
    frames = {name: reader.motion("walk").rotations for name, reader in kept.items()}
    assert frames["truth"].shape == (48, *frames["solve"].shape[1:])
    assert np.abs(frames["solve"] - frames["truth"]).mean() < 0.2 * np.abs(frames["slerp"] - frames["truth"]).mean()
    for reader in kept.values():
        assert reader.artefact.manifest.licences == ["a licence"]
        reader.close()
