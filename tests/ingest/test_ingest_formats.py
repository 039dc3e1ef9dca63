"""Ingest of mixed formats: what each file is, its skeleton found beside it, and a row for every file met."""

from __future__ import annotations

import io
import re
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact
from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.source_table import read_sources
from pumps_cli.app import main
from stages.data.pick.config import Config as PickConfig
from stages.data.pick.run import run as pick_clips
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import rate_of
from tests.shared.formats.amass_files import new_layout, npz, old_layout
from tests.shared.formats.asf_texts import AsfText
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.gltf_files import GltfText
from tests.shared.formats.robot_files import RobotText, csv_of, some_rows

MIX = {
    "bvh/walk.bvh": BvhText(frames=12).data(),
    "cmu/07/07.asf": AsfText().asf(),
    "cmu/07/07_01.amc": AsfText(frames=9).amc(),
    "cmu/08/08.asf": AsfText(scale=1.1).asf(),
    "cmu/08/08_01.amc": AsfText(frames=7, scale=1.1).amc(),
    "amass/old_poses.npz": old_layout(),
    "amass/new_stageii.npz": new_layout(),
    "amass/shape.npz": npz(betas=np.zeros(16), gender=np.array("male")),
    "amass/broken_poses.npz": old_layout()[:-300],
    "notes.txt": b"walks, mostly",
    "splits.json": b'{"mix": {"test": ["bvh/walk.bvh"], "val": []}}',
    "secret.fbx": b"Kaydara FBX Binary  \x00",
}
OUTCOMES = {
    "amass/broken_poses.npz": ("amass", "skipped"), "amass/new_stageii.npz": ("amass", "kept"),
    "amass/old_poses.npz": ("amass", "kept"), "amass/shape.npz": ("", "ignored"), "bvh/walk.bvh": ("bvh", "kept"),
    "cmu/07/07_01.amc": ("asf", "kept"), "cmu/08/08_01.amc": ("asf", "kept"), "notes.txt": ("", "ignored"),
    "splits.json": ("", "ignored"),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, data in MIX.items():
        path = tmp_path / "mix" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return tmp_path / "mix"


@pytest.fixture
def tar(tmp_path: Path) -> Path:
    with tarfile.open(tmp_path / "mix.tar.gz", "w:gz") as archive:
        for name, data in MIX.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return tmp_path / "mix.tar.gz"


def _table(output: Path) -> dict[str, tuple[str, str]]:
    rows = read_sources(open_artefact(output, "motion").folder)
    return {row.source.split("mix/")[-1].split("!")[-1]: (row.format, row.outcome) for row in rows}


@pytest.mark.parametrize("kind", ["folder", "tar"])
def test_a_mix_is_read_by_content_with_a_row_for_every_file(
    kind: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    report = run(Config(sources=(str(request.getfixturevalue(kind)),), output=tmp_path / "out"))
    assert _table(tmp_path / "out") == OUTCOMES
    assert report.figures["files"] == {"kept": 5, "skipped": 1, "ignored": 3}
    with MotionReader(tmp_path / "out") as reader:
        frames = {row.clip.removeprefix("mix."): row.frames for row in reader.clips}
        assert frames == {
            "bvh.walk": 12,
            "cmu.07.07_01": 9,
            "cmu.08.08_01": 7,
            "amass.old_poses": 8,
            "amass.new_stageii": 8,
        }
        assert len(reader.skeletons()) == 5, "each subject of CMU has a skeleton of its own"
    rows = {Path(row.source).name: row for row in read_sources(open_artefact(tmp_path / "out").folder)}
    broken = next(row for row in rows.values() if row.outcome == "skipped")
    assert "broken_poses.npz" in broken.reason and broken.frames == 0
    kept = next(row for name, row in rows.items() if name.endswith("07_01.amc"))
    assert (kept.clips, kept.frames) == (1, 9) and len(kept.sha256) == 64 and "120 frames" in kept.remarks
    assert kept.flags == "no-frame-rate"
    assert kept.bytes == len(MIX["cmu/07/07_01.amc"])


def test_strict_stops_at_a_bad_file_but_not_at_what_is_no_recording(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="broken_poses"):
        run(Config(sources=(str(folder),), output=tmp_path / "out", strict=True))
    (folder / "amass" / "broken_poses.npz").unlink()
    run(Config(sources=(str(folder),), output=tmp_path / "out", strict=True))


def test_a_file_that_is_named_itself_is_not_skipped(folder: Path, tmp_path: Path) -> None:
    for name, says in (("notes.txt", "not a recording"), ("secret.fbx", "FBX")):
        with pytest.raises(InputError, match=says):
            run(Config(sources=(str(folder / name),), output=tmp_path / "out"))


def test_one_format_takes_only_its_own_files(folder: Path, tmp_path: Path) -> None:
    run(Config(sources=(str(folder),), output=tmp_path / "out", format="asf"))
    assert set(_table(tmp_path / "out")) == {"cmu/07/07_01.amc", "cmu/08/08_01.amc"}


def test_a_skeleton_given_as_an_option(folder: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone.amc"
    alone.write_bytes(AsfText(frames=9).amc())
    with pytest.raises(InputError, match="there is no ASF in its folder"):
        run(Config(sources=(str(alone),), output=tmp_path / "out"))
    run(Config(sources=(str(alone),), output=tmp_path / "out", skeleton=str(folder / "cmu" / "07" / "07.asf")))
    assert open_artefact(tmp_path / "out").manifest.summary["formats"] == {"asf": 1}


def test_of_several_skeletons_the_one_that_begins_the_name_counts(tmp_path: Path) -> None:
    for name, data in (
        ("07.asf", AsfText().asf()),
        ("07_1.asf", AsfText(scale=1.1).asf()),
        ("07_1_a.amc", AsfText().amc()),
    ):
        (tmp_path / name).write_bytes(data)
    run(Config(sources=(str(tmp_path),), output=tmp_path / "out"))
    with MotionReader(tmp_path / "out") as reader:
        skeleton = reader.skeleton(reader.clips[0].skeleton)
        assert np.linalg.norm(skeleton.offsets[skeleton.names.index("ltibia")]) == pytest.approx(
            7.2 * 1.1 * 0.0564, rel=1e-2
        )


def test_a_list_on_standard_input(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for text in (f"{folder}/bvh\n{folder}/cmu/07/07_01.amc\n", f"{folder}/bvh\0{folder}/cmu/07/07_01.amc\0"):
        monkeypatch.setattr("sys.stdin", io.StringIO(text))
        with pytest.raises(SystemExit) as leaving:
            main(["ingest", "auto", "-", "-o", str(tmp_path / "out"), "--overwrite"])
        assert not leaving.value.code
        assert set(_table(tmp_path / "out")) == {"bvh/walk.bvh", "cmu/07/07_01.amc"}
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    with pytest.raises(SystemExit) as leaving:
        main(["ingest", "auto", "-", "-o", str(tmp_path / "out")])
    assert leaving.value.code == 2


def test_one_bad_file_among_many(tmp_path: Path) -> None:
    (tmp_path / "takes").mkdir()
    good = BvhText(frames=2).data()
    for i in range(100):
        (tmp_path / "takes" / f"{i:04}.bvh").write_bytes(good if i != 77 else good[: len(good) // 2])
    report = run(Config(sources=(str(tmp_path / "takes"),), output=tmp_path / "out"))
    assert report.figures["files"] == {"kept": 99, "skipped": 1}
    (bad,) = [row for row in read_sources(open_artefact(tmp_path / "out").folder) if row.outcome == "skipped"]
    assert bad.source.endswith("0077.bvh") and "MOTION" in bad.reason
    assert any("0077.bvh" in line for line in report.lines)


def test_clips_of_other_formats_are_picked_as_bvh(folder: Path, tmp_path: Path) -> None:
    run(Config(sources=(str(folder),), output=tmp_path / "out"))
    pick_clips(
        PickConfig(motion=tmp_path / "out", output=tmp_path / "picked", splits=("train", "val", "test"), count=9)
    )
    picked = {path.stem: read_bvh(path.read_bytes(), path.name) for path in (tmp_path / "picked").glob("*.bvh")}
    assert len(picked) == 5
    assert (tmp_path / "picked" / "mix.bvh.walk.bvh").read_bytes() == MIX["bvh/walk.bvh"]
    assert picked["mix.cmu.07.07_01"].frames == 9 and rate_of(picked["mix.cmu.07.07_01"].frame_time) == 120


def test_hostile_names_stay_inside_the_artefact(tmp_path: Path) -> None:
    names = [
        "a/..x../walk.bvh",
        "...bvh",
        "con.bvh",
        "a\nb.bvh",
        "é\u202e/x y.bvh",
        "-rf.bvh",
        "~root.bvh",
        "c" * 250 + ".bvh",
    ]
    with zipfile.ZipFile(tmp_path / "odd.zip", "w") as archive:
        for i, name in enumerate(names):
            archive.writestr(name, BvhText(frames=3, seed=i).data())
        parts = GltfText(frames=3, parts=("../../up", "/etc/x", "a\0b"))
        archive.writestr("figure.glb", parts.data())
    before = set(tmp_path.parent.rglob("*"))
    run(Config(sources=(str(tmp_path / "odd.zip"),), output=tmp_path / "out"))
    fresh = set(tmp_path.parent.rglob("*")) - before - {tmp_path / "out"}
    assert fresh and all(tmp_path / "out" in path.parents for path in fresh)
    with MotionReader(tmp_path / "out") as reader:
        clips = [row.clip for row in reader.clips]
        assert len(clips) == len(names) + 3 == len(set(clips))
        assert all(re.fullmatch(r"[A-Za-z0-9_.-]{1,200}", clip) and clip.strip(".") for clip in clips)
        assert all(reader.motion(clip).frames == 3 for clip in clips)


def test_a_recording_in_two_formats_is_on_one_side_of_the_split(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "robots.zip", "w") as archive:
        archive.writestr("robots/g.urdf", RobotText().urdf())
        for clip in "abc":
            archive.writestr(f"robots/csv/{clip}.csv", csv_of(some_rows(8)))
            archive.writestr(f"robots/{clip}.bvh", BvhText(frames=8).data())
    splits = tmp_path / "splits.json"
    splits.write_text('{"robots.zip": {"test": ["robots/b.bvh"], "val": ["robots/csv/c.csv"]}}')
    report = run(Config(sources=(str(tmp_path / "robots.zip"),), output=tmp_path / "out", splits=splits))
    assert "3 recordings of robots.zip seem to exist in several formats" in " ".join(report.lines)
    with MotionReader(tmp_path / "out") as reader:
        sides: dict[str, set[str]] = {}
        for row in reader.clips:
            sides.setdefault(Path(row.source).stem, set()).add(row.split)
    assert sides == {"a": {"train"}, "b": {"test"}, "c": {"val"}}
