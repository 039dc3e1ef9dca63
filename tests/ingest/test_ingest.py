"""Ingest: archives of several rigs into one artefact, an outcome for every file, splits, licences, overrides."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.motion import MotionReader
from data_schemas.source_table import read_sources
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.formats.reading import Job, read_all
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import find_sources
from tests.shared.formats.bvh_texts import BvhText


def _zip(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def _calibrated(text: BvhText) -> bytes:
    lines = text.text().split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    lines[first] = " ".join("0" for _ in lines[first].split())
    return "\n".join(lines).encode()


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    return _zip(
        tmp_path / "cmu-dance.zip",
        {
            "cmu-dance/indian/01.bvh": BvhText(frames=40, seed=1).data(),
            "cmu-dance/salsa/01.bvh": _calibrated(BvhText(frames=60, seed=2)),
            "cmu-dance/salsa/02.bvh": BvhText(frames=40, seed=3, declared=41).data(),
            "cmu-dance/other/rooted.bvh": BvhText(frames=40, seed=4, above="joint_Root").data(),
            "cmu-dance/other/cut.bvh": BvhText(frames=40, seed=5).data()[:-100],
            "cmu-dance/other/pose.bvh": BvhText(frames=1).data(),
        },
    )


def test_every_file_has_an_outcome(archive: Path, tmp_path: Path) -> None:
    report = run(Config(sources=(str(archive),), output=tmp_path / "motion", fps_override=("*salsa*=60",)))
    manifest = open_artefact(tmp_path / "motion", "motion").manifest
    outcomes = {row.source.split("!")[1]: row for row in read_sources(open_artefact(tmp_path / "motion").folder)}
    assert {name.split("/", 1)[1]: row.outcome for name, row in outcomes.items()} == {
        "indian/01.bvh": "kept",
        "other/cut.bvh": "skipped",
        "other/pose.bvh": "skipped",
        "other/rooted.bvh": "kept",
        "salsa/01.bvh": "repaired",
        "salsa/02.bvh": "repaired",
    }
    assert outcomes["cmu-dance/salsa/01.bvh"].flags == "fps-override trimmed"
    assert outcomes["cmu-dance/other/cut.bvh"].flags == outcomes["cmu-dance/other/rooted.bvh"].flags == ""
    assert "line" in outcomes["cmu-dance/other/cut.bvh"].reason
    assert "1 frame" in outcomes["cmu-dance/other/pose.bvh"].reason
    assert any("cut.bvh" in line for line in report.lines)
    assert report.figures["files"] == {"kept": 2, "repaired": 2, "skipped": 2}
    assert any("mocap.cs.cmu.edu" in licence for licence in manifest.licences)
    with MotionReader(tmp_path / "motion") as reader:
        rows = {row.clip: row for row in reader.clips}
        assert set(rows) == {f"cmu-dance.{name}" for name in ("indian.01", "other.rooted", "salsa.01", "salsa.02")}
        assert rows["cmu-dance.salsa.01"].fps == 60 and rows["cmu-dance.indian.01"].fps == 30
        assert rows["cmu-dance.salsa.01"].frames == 59
        assert rows["cmu-dance.salsa.01"].flags == "fps-override trimmed"
        assert rows["cmu-dance.salsa.02"].flags == "fps-override frames-line-off"
        assert len(reader.skeletons()) == 2
        for row in reader.clips:
            motion = reader.motion(row.clip)
            assert motion.frames == row.frames and row.seconds == row.frames / row.fps
            assert len(row.sha256) == 64 and row.source.startswith(str(archive))
        assert reader.motion("cmu-dance.other.rooted").track_joints.tolist() == [1]


def test_strict_stops_at_the_first_bad_file_and_leaves_what_was_there(archive: Path, tmp_path: Path) -> None:
    good = tmp_path / "good.bvh"
    good.write_bytes(BvhText(frames=30).data())
    run(Config(sources=(str(good),), output=tmp_path / "motion"))
    before = open_artefact(tmp_path / "motion").manifest.digest
    with pytest.raises(InputError, match=r"cut\.bvh, line"):
        run(Config(sources=(str(archive),), output=tmp_path / "motion", strict=True, overwrite=True))
    assert open_artefact(tmp_path / "motion").manifest.digest == before


def test_nothing_usable_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.bvh").write_bytes(b"HIERARCHY\nROOT")
    with pytest.raises(InputError, match="None of the 1 recordings"):
        run(Config(sources=(str(tmp_path),), output=tmp_path / "motion"))
    assert not (tmp_path / "motion").exists()


@pytest.mark.parametrize("options", [{"fps_override": ("salsa",)}, {"fps_override": ("*=0",)}, {"trim_first": "few"}])
def test_invalid_options_are_refused(archive: Path, tmp_path: Path, options: dict) -> None:
    with pytest.raises(UsageError):
        run(Config(sources=(str(archive),), output=tmp_path / "motion", **options))


def _splits_of(output: Path) -> dict[str, str]:
    with MotionReader(output) as reader:
        return {row.clip.split(".", 1)[1]: row.split for row in reader.clips}


def test_splits_from_a_file_beside_the_archive_and_from_one_given(archive: Path, tmp_path: Path) -> None:
    beside = {"cmu-dance.zip": {"test": ["cmu-dance/salsa/01.bvh", "cmu-dance/gone.bvh"], "val": []}}
    (tmp_path / "splits.json").write_text(json.dumps(beside))
    report = run(Config(sources=(str(archive),), output=tmp_path / "motion"))
    assert _splits_of(tmp_path / "motion") == {
        "indian.01": "train", "other.rooted": "train", "salsa.01": "test", "salsa.02": "train",
    }  # fmt: skip
    assert any("gone.bvh" in line for line in report.lines)
    given = tmp_path / "mine.json"
    given.write_text(json.dumps({"cmu-dance.zip": {"val": ["cmu-dance/indian/01.bvh"], "licence": "mine"}}))
    run(Config(sources=(str(archive),), output=tmp_path / "motion", splits=given, overwrite=True))
    assert _splits_of(tmp_path / "motion")["indian.01"] == "val"
    assert _splits_of(tmp_path / "motion")["salsa.01"] == "train"
    assert open_artefact(tmp_path / "motion").manifest.licences == ["mine"]
    for bad in ("[]", "{", '{"a": {"test": "x"}}', '{"a": []}'):
        given.write_text(bad)
        with pytest.raises(InputError, match=r"mine\.json"):
            run(Config(sources=(str(archive),), output=tmp_path / "motion", splits=given, overwrite=True))


def test_without_a_file_splits_follow_from_names_alone(tmp_path: Path) -> None:
    folder = tmp_path / "takes"
    folder.mkdir()
    for i in range(12):
        (folder / f"take{i}.bvh").write_bytes(BvhText(frames=8, seed=i).data())
    run(Config(sources=(str(folder),), output=tmp_path / "motion", licence="CC0"))
    splits = _splits_of(tmp_path / "motion")
    assert sorted(splits.values()) == ["test"] + ["train"] * 10 + ["val"]
    run(Config(sources=tuple(str(p) for p in sorted(folder.iterdir(), reverse=True)), output=tmp_path / "again"))
    assert _splits_of(tmp_path / "again") == splits
    assert open_artefact(tmp_path / "motion").manifest.licences == ["CC0"]


def test_the_same_input_gives_the_same_digest_with_any_number_of_processes(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stages.shared.formats.reading._POOL_FROM_BYTES", 0)
    monkeypatch.setattr("stages.shared.formats.reading._BATCH_BYTES", 1)
    digests = set()
    for workers in (1, 2):
        output = tmp_path / f"motion{workers}"
        run(Config(sources=(str(archive),), output=output, workers=workers))
        digests.add(open_artefact(output).manifest.digest)
    assert len(digests) == 1


def test_outcomes_come_in_order_from_many_processes(archive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stages.shared.formats.reading._POOL_FROM_BYTES", 0)
    jobs = [Job(source, "auto", Asked()) for source in find_sources([str(archive)])] * 3
    many, one = list(read_all(jobs, 2)), list(read_all(jobs, 1))
    assert [outcome.source for outcome in many] == [job.source for job in jobs]
    for a, b in zip(many, one, strict=True):
        assert a.status == b.status and a.notes == b.notes
        for one_clip, other in zip(a.recordings, b.recordings, strict=True):
            assert np.array_equal(one_clip.motion.rotations, other.motion.rotations)


def test_clips_of_one_name_stay_apart(tmp_path: Path) -> None:
    for folder in ("a/takes", "b/takes"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "walk 1.bvh").write_bytes(BvhText(frames=8).data())
    run(Config(sources=(str(tmp_path / "a" / "takes"), str(tmp_path / "b" / "takes")), output=tmp_path / "motion"))
    with MotionReader(tmp_path / "motion") as reader:
        assert [row.clip for row in reader.clips] == ["takes.walk_1", "takes.walk_1-2"]
