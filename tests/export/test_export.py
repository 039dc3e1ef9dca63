"""The export command: every form from recordings and artefacts, held against independent readers; other rigs."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from data_schemas.errors import InputError, UsageError
from stages.export.config import Config
from stages.export.run import SUFFIXES, run
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.glb_reading import read_glb
from tests.shared.formats.robot_files import RobotText, csv_of, some_rows

TEXT = BvhText(frames=24, orders={"Head": ("Yrotation", "Xrotation", "Zrotation")})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """walk.bvh, turn.bvh, and both as a motion artefact."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "walk.bvh").write_bytes(TEXT.data())
    (folder / "turn.bvh").write_bytes(BvhText(frames=9, seed=3, above="joint_Root", z_up=True).data())
    ingest(IngestConfig(sources=(str(folder / "*.bvh"),), output=folder / "motion", licence="CC0"))
    return folder


def _expected(path: Path) -> tuple[tuple[str, ...], np.ndarray]:
    skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), path.name))
    return skeleton.names, positions_of(skeleton, motion)


@pytest.mark.parametrize("source", ["walk.bvh", "motion"])
@pytest.mark.parametrize("kind", [kind for kind in SUFFIXES if kind != "robot-csv"])
def test_every_form_from_a_file_and_from_an_artefact(folder: Path, tmp_path: Path, kind: str, source: str) -> None:
    clip = next(name for name in _clips(folder) if name.endswith("walk")) if source == "motion" else "walk"
    path = tmp_path / f"out{SUFFIXES[kind]}"
    report = run(Config(input=str(folder / source), output=path, clip=(clip,)))
    assert report.figures["format"] == kind and report.figures["files"] == [str(path)]
    names, places = _expected(folder / "walk.bvh")
    data = path.read_bytes()
    if kind == "bvh":
        assert data.partition(b"MOTION")[0] == TEXT.data().partition(b"MOTION")[0]
        found = _by_pymotion(path) / 100
    elif kind == "glb":
        found = read_glb(data).world()[1][:, : len(names)]
    elif kind == "csv":
        rows = list(csv.DictReader(io.StringIO(data.decode())))
        found = np.array([[[float(row[f"{name}.{axis}"]) for axis in "xyz"] for name in names] for row in rows])
    elif kind == "parquet":
        table = pq.read_table(io.BytesIO(data)).to_pydict()
        found = np.stack([table[axis] for axis in "xyz"], axis=-1).reshape(-1, len(names), 3)
    else:
        with np.load(io.BytesIO(data)) as arrays:
            found, places = arrays["trans"][:, None, [0, 2, 1]] * (1, 1, -1), places[:, :1]
    assert found.shape == places.shape and np.abs(found - places).max() < 1e-4


def _clips(folder: Path) -> list[str]:
    from data_schemas.motion import MotionReader

    with MotionReader(folder / "motion") as reader:
        return [row.clip for row in reader.clips]


def _by_pymotion(path: Path) -> np.ndarray:
    pytest.importorskip("pymotion")
    from pymotion.io.bvh import BVH
    from pymotion.ops.skeleton import fk

    reader = BVH()
    path.write_bytes(path.read_bytes().rstrip() + b"\n")
    reader.load(str(path))
    rotations, places, parents, offsets, *_ = reader.get_data()
    return fk(rotations, places[:, 0], offsets, parents)[0]


def test_all_clips_into_a_folder(folder: Path, tmp_path: Path) -> None:
    report = run(Config(input=str(folder / "motion"), output=tmp_path / "out", format="glb"))
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(f"{c}.glb" for c in _clips(folder))
    assert len(report.figures["files"]) == 2
    with pytest.raises(UsageError, match="exists"):
        run(Config(input=str(folder / "motion"), output=tmp_path / "out", format="glb"))
    run(Config(input=str(folder / "motion"), output=tmp_path / "out", format="glb", overwrite=True))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"output": "out"}, "not said what to write"),
        ({"output": "out.fbx"}, "suffix that pumps does not write"),
        ({"output": "out.csv", "rig": "walk.bvh"}, "--rig is for BVH"),
        ({"output": "out.glb"}, "several clips"),
        ({"output": "out.glb", "fps_override": 30.0}, "--fps-override is for recordings"),
        ({"output": "out.glb", "clip": ("gone",)}, "no clip gone"),
    ],
)
def test_what_cannot_be_is_refused(folder: Path, tmp_path: Path, settings: dict, message: str) -> None:
    settings = {**settings, "output": tmp_path / settings["output"]}
    with pytest.raises((UsageError, InputError), match=message):
        run(Config(input=str(folder / "motion"), **settings))
    assert not settings["output"].exists()


# --- other rigs ---------------------------------------------------------------------------------


def test_another_header_of_the_same_rig(folder: Path, tmp_path: Path) -> None:
    """Another unit, other channel orders, other axes of the world: the same places come out of it."""
    other = BvhText(frames=2, scale=0.01, z_up=True, number="{:.9f}", placed=("Hips", "Neck"))
    other.orders = {name: ("Xrotation", "Yrotation", "Zrotation") for name, _, _ in other.joints()}
    (tmp_path / "rig.bvh").write_bytes(other.data())
    out = tmp_path / "out.bvh"
    run(Config(input=str(folder / "walk.bvh"), output=out, rig=str(tmp_path / "rig.bvh")))
    bvh = read_bvh(out.read_bytes(), "out")
    assert bvh.header == other.header() and 1 / bvh.frame_time == pytest.approx(30, rel=1e-5)
    skeleton, motion, _ = motion_of(bvh)
    assert skeleton.unit_m == 1.0 and skeleton.up_axis == "z"
    names, places = _expected(folder / "walk.bvh")
    order = [skeleton.names.index(name) for name in names]
    assert np.abs(positions_of(skeleton, motion)[:, order] - places).max() < 1e-4


def test_a_rig_of_other_lengths_keeps_them_and_says_so(folder: Path, tmp_path: Path) -> None:
    longer = TEXT.data().replace(b"OFFSET 0.000000 -42.000000 1.000000", b"OFFSET 0.000000 -52.000000 1.238095")
    (tmp_path / "rig.bvh").write_bytes(longer)
    report = run(Config(input=str(folder / "walk.bvh"), output=tmp_path / "o.bvh", rig=str(tmp_path / "rig.bvh")))
    assert any("differs most, by 0.100 m" in line for line in report.lines)


def test_a_rig_that_does_not_correspond_is_refused_with_all_reasons(folder: Path, tmp_path: Path) -> None:
    text = TEXT.data().replace(b"JOINT LeftToe", b"JOINT LeftToes")
    text = text.replace(b"OFFSET 27.000000 0.000000 0.000000", b"OFFSET 0.000000 27.000000 0.000000")
    (tmp_path / "rig.bvh").write_bytes(text)
    with pytest.raises(InputError) as caught:
        run(Config(input=str(folder / "walk.bvh"), output=tmp_path / "o.bvh", rig=str(tmp_path / "rig.bvh")))
    for part in ("no joint LeftToe", "LeftToes is not in the motion", "the bone to LeftForeArm points elsewhere"):
        assert part in caught.value.message
    assert "pumps retarget" in (caught.value.hint or "") and not (tmp_path / "o.bvh").exists()


def test_a_robots_angles_come_back_from_a_recording_and_an_artefact(tmp_path: Path) -> None:
    rows = some_rows(20)
    (tmp_path / "a.csv").write_bytes(csv_of(rows))
    rig = tmp_path / "robot.urdf"
    rig.write_bytes(RobotText().urdf())
    ingest(IngestConfig(sources=(str(tmp_path / "a.csv"),), output=tmp_path / "motion", fps_override=("*=60",)))
    run(Config(input=str(tmp_path / "motion"), output=tmp_path / "b.csv", rig=str(rig)))  # by the rig's suffix
    given = Config(input=str(tmp_path / "a.csv"), output=tmp_path / "c.csv", format="robot-csv", skeleton=str(rig))
    report = run(given)
    assert report.figures["format"] == "robot-csv"
    for name in ("b.csv", "c.csv"):
        assert np.abs(np.loadtxt(tmp_path / name, delimiter=",") - rows).max() < 2e-6
    run(Config(input=str(tmp_path / "motion"), output=tmp_path / "d.csv"))
    assert (tmp_path / "d.csv").read_text().startswith("frame") or ".x" in (tmp_path / "d.csv").read_text()[:400]


def test_limits_are_kept_on_request(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(csv_of(some_rows(20)))
    (tmp_path / "robot.urdf").write_bytes(RobotText(limits=(-0.1, 0.1)).urdf())
    options = {"input": str(tmp_path / "a.csv"), "rig": str(tmp_path / "robot.urdf"), "fps_override": 30.0}
    free = run(Config(output=tmp_path / "b.csv", **options))
    held = run(Config(output=tmp_path / "c.csv", respect_limits=True, **options))
    assert "lie beyond" in free.lines[1] and "held at a limit" in held.lines[1]
    angles = np.loadtxt(tmp_path / "c.csv", delimiter=",")[:, 7:11]
    assert np.abs(angles).max() <= 0.1 < np.abs(np.loadtxt(tmp_path / "b.csv", delimiter=",")[:, 7:11]).max()


def test_options_of_robots_are_for_robots(folder: Path, tmp_path: Path) -> None:
    walk = str(folder / "walk.bvh")
    with pytest.raises(UsageError, match="which robot"):
        run(Config(input=walk, output=tmp_path / "o.csv", format="robot-csv"))
    with pytest.raises(UsageError, match="--respect-limits"):
        run(Config(input=walk, output=tmp_path / "o.bvh", respect_limits=True))
    (tmp_path / "robot.urdf").write_bytes(RobotText().urdf())
    with pytest.raises(InputError, match="is not on the robot"):
        run(Config(input=walk, output=tmp_path / "o.csv", rig=str(tmp_path / "robot.urdf")))
