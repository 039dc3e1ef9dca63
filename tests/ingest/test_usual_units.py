"""Tables of positions state no unit: the recordings of one rig in one data set have one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from data_schemas.motion import MotionReader
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.positions import read_positions
from stages.shared.formats.recording import Asked
from tests.shared.formats.amass_files import npz
from tests.shared.formats.position_files import NAMES, PLACES, RIG, csv_of_places

CHILD = 0.33  # times an adult: in centimetres, about an adult in inches


def found(tmp_path: Path, sizes: dict[str, float], **options: object) -> dict[str, tuple[float, bool]]:
    """Name of each clip -> metres in its unit, and whether ingest is unsure of it."""
    folder = tmp_path / "mocap"
    for name, size in sizes.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(csv_of_places(list(NAMES), size * PLACES))
    (tmp_path / "rig.bvh").write_bytes(RIG.data())
    output = tmp_path / "out"
    run(Config(sources=(str(folder),), output=output, skeleton=str(tmp_path / "rig.bvh"), licence="CC0", workers=1,
               fps_override=("*=30",), overwrite=True, **options))  # fmt: skip
    with MotionReader(output) as reader:
        return {
            row.source.rpartition("/")[2]: (reader.skeleton(row.skeleton).unit_m, "unit-uncertain" in row.flags)
            for row in reader.clips
        }


def test_alone_the_child_is_taken_for_an_adult_in_inches() -> None:
    data = csv_of_places(list(NAMES), CHILD * PLACES)
    (recording,) = read_positions(data, "child.csv", Asked(rig=RIG.data(), rig_name="rig.bvh"))
    assert recording.skeleton.unit_m == 0.0254


@pytest.mark.parametrize("child", ["a.csv", "m.csv", "z.csv"])
def test_a_child_among_adults_has_their_unit_and_is_flagged(tmp_path: Path, child: str) -> None:
    units = found(tmp_path, {"b.csv": 1.0, "c.csv": 1.1, "y.csv": 0.95, child: CHILD})
    assert {name: unit for name, (unit, _) in units.items()} == dict.fromkeys(units, 0.01)
    assert [name for name, (_, unsure) in units.items() if unsure] == [child]


def test_files_that_can_only_be_in_another_unit_keep_it(tmp_path: Path) -> None:
    units = found(tmp_path, {"a.csv": 1.0, "b.csv": 1.0, "metres.csv": 0.01, "c.csv": 1.0})
    assert units == {
        "a.csv": (0.01, False),
        "b.csv": (0.01, False),
        "c.csv": (0.01, False),
        "metres.csv": (1.0, False),
    }


def test_parts_of_an_ingest_have_the_unit_of_the_whole(tmp_path: Path) -> None:
    sizes = {"a.csv": CHILD, "b.csv": 1.0, "c.csv": CHILD, "d.csv": 1.0, "e.csv": 1.0}
    assert found(tmp_path, sizes, shard="1/2") == {
        "a.csv": (0.01, True),
        "c.csv": (0.01, True),
        "e.csv": (0.01, False),
    }


def test_a_data_set_of_children_alone_is_read_as_before(tmp_path: Path) -> None:
    assert {unit for unit, _ in found(tmp_path, {"a.csv": CHILD, "b.csv": CHILD}).values()} == {0.0254}


def test_other_rigs_of_the_data_set_keep_their_unit(tmp_path: Path) -> None:
    """Centimetres and inches in one folder, on rigs of other names."""
    (tmp_path / "mocap").mkdir()
    parents = motion_of(read_bvh(RIG.data(), "rig.bvh"))[0].parents
    names = np.array([f"mixamorig:{name}" for name in NAMES])
    for name in "cd":
        data = npz(positions=PLACES / 2.54, names=names, parents=parents)
        (tmp_path / "mocap" / f"{name}.npz").write_bytes(data)
    for name in "ab":
        (tmp_path / "mocap" / f"{name}.csv").write_bytes(csv_of_places(list(NAMES), PLACES))
        about = {"names": list(NAMES), "parents": parents.tolist()}
        (tmp_path / "mocap" / f"{name}.json").write_text(json.dumps(about))
    run(Config(sources=(str(tmp_path / "mocap"),), output=tmp_path / "out", licence="CC0", workers=1))
    with MotionReader(tmp_path / "out") as reader:
        units = {row.source[-5:]: reader.skeleton(row.skeleton).unit_m for row in reader.clips}
    assert units == {"a.csv": 0.01, "b.csv": 0.01, "c.npz": 0.0254, "d.npz": 0.0254}
