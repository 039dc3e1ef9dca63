"""`pumps infill` on a robot's joint angles: the same layout back, keys byte for byte, nothing read between."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from stages.infill.config import Config
from stages.infill.run import run
from stages.shared.formats.robot_rig import robot_rig
from stages.shared.formats.robot_table import ROOT_COLUMNS, RobotTable, read_table
from tests.shared.formats.robot_files import ANGLES, JOINTS, RobotText, csv_of, some_rows

RIG = robot_rig(RobotText().urdf(), "t.urdf")
KEYS = (0, 12, 30)


@pytest.fixture
def source(tmp_path) -> Path:
    (tmp_path / "robot.urdf").write_bytes(RobotText().urdf())
    path = tmp_path / "in.csv"
    path.write_bytes(csv_of(some_rows(40)))
    return path


def fill(source: Path, weights: str, **options) -> bytes:
    options = {"points": 48, "device": "cpu", "overwrite": True, "fps_override": 30.0, **options}
    if not {"transition", "predict", "frames"} & set(options):
        options = {"keyframes": ",".join(map(str, KEYS)), **options}
    output = source.parent / "out.csv"
    run(Config(input=source, output=output, weights=weights, **options))
    return output.read_bytes()


def table(data: bytes) -> RobotTable:
    return read_table(data, "out.csv", RIG)


def test_keys_and_what_lies_outside_come_back_byte_for_byte(source, weights):
    made = fill(source, weights).split(b"\n")
    before = source.read_bytes().split(b"\n")
    assert len(made) == len(before) and made[-1] == b""
    same = [row for row in range(40) if made[row] == before[row]]
    assert same == [0, 12, *range(30, 40)]
    values = table(b"\n".join(made)).values
    assert np.allclose(np.linalg.norm(values[:, 3:7], axis=1), 1, atol=1e-5)
    steps = np.abs(np.diff(values[:31], axis=0))
    assert steps[:, 7:].max() < 0.5 and steps[:, 3:7].max() < 0.2


def test_names_newlines_and_other_columns_stay(source, weights):
    rows = np.hstack([np.arange(40)[:, None], some_rows(40)])
    data = csv_of(rows, ",".join(["frame", *ROOT_COLUMNS, *ANGLES]), "\r\n")
    source.write_bytes(data)
    made = fill(source, weights)
    assert made.split(b"\r\n")[0] == data.split(b"\r\n")[0] and made.count(b"\r\n") == made.count(b"\n") == 41
    assert table(made).raw[:, 0].tolist() == list(range(40))
    for key in KEYS:
        assert made.split(b"\r\n")[key + 1] == data.split(b"\r\n")[key + 1]


def test_junk_between_keys_changes_no_byte(source, weights):
    clean = fill(source, weights)
    lines = source.read_bytes().split(b"\n")
    lines[1], lines[5], lines[13], lines[20] = b"", b"nan," * 21 + b"nan", b"what is this", b"0,1,2"
    lines[25] = b",".join([b"9.123456789"] * 22)
    source.write_bytes(b"\n".join(lines))
    assert fill(source, weights) == clean


def test_a_first_row_of_junk_is_no_line_of_names(source, weights):
    clean = fill(source, weights, keyframes="2,12,30").split(b"\n")
    lines = source.read_bytes().split(b"\n")
    lines[0], lines[1] = b"junk;junk", b"0,0"
    source.write_bytes(b"\n".join(lines))
    assert fill(source, weights, keyframes="2,12,30").split(b"\n") == [b"junk;junk", b"0,0", *clean[2:]]


def test_a_key_of_junk_is_refused(source, weights):
    lines = source.read_bytes().split(b"\n")
    lines[12] = lines[12].replace(b"0.", b"nan", 1)
    source.write_bytes(b"\n".join(lines))
    with pytest.raises(InputError, match="line 13"):
        fill(source, weights)


def test_frames_are_appended_and_sparse_keys_spread(source, weights):
    assert table(fill(source, weights, predict=7)).frames == 47
    source.write_bytes(b"\n".join(source.read_bytes().split(b"\n")[:3]) + b"\n")
    made = table(fill(source, weights, frames="0,9,20"))
    assert made.frames == 21 and [made.lines[frame] for frame in (0, 9, 20)] == source.read_bytes().split(b"\n")[:3]


def test_whole_turns_and_the_quaternions_sign_are_those_of_the_key_before(source, weights):
    rows = some_rows(40)
    rows[:, 7 + ANGLES.index("left_wrist_joint")] += 2 * np.pi
    rows[:, 3:7] *= -1
    source.write_bytes(csv_of(rows))
    values = table(fill(source, weights)).values
    assert np.abs(np.diff(values, axis=0))[:, 3:].max() < 0.5


def test_filled_angles_keep_their_limits(source, weights):
    rows = some_rows(40)
    limits = (-0.3, 0.3)
    rows[:, 7:] = np.clip(rows[:, 7:] * 3, *limits)
    source.write_bytes(csv_of(rows))
    (source.parent / "robot.urdf").write_bytes(RobotText(limits=limits).urdf())
    values = table(fill(source, weights, respect_limits=True)).values[:, 7:]
    turning = [i for i, name in enumerate(ANGLES) if "wrist" not in name]
    assert values[:, turning].min() >= -0.300001 and values[:, turning].max() <= 0.300001


def test_what_cannot_be_is_said(source, weights):
    (source.parent / "robot.urdf").unlink()
    with pytest.raises(InputError) as caught:
        fill(source, weights)
    assert "--skeleton" in (caught.value.hint or "")
    bvh = source.parent / "a.bvh"
    bvh.write_bytes((Path(__file__).parents[2] / "stages/shared/clips/walk.bvh").read_bytes())
    for option in ({"skeleton": "robot.urdf"}, {"respect_limits": True}):
        with pytest.raises(UsageError, match="joint angles"):
            fill(bvh, weights, **option)


def test_names_of_columns_are_no_formulas_and_are_read_back(source, weights):
    """A spreadsheet runs a name that begins with =, +, -, @; all else of the line stays as it was."""
    text = RobotText(joints=tuple((f"{'=-@+'[at % 4]}{each[0]}", *each[1:]) for at, each in enumerate(JOINTS)))
    (source.parent / "robot.urdf").write_bytes(text.urdf())
    names = [f'"{name}"' if at % 2 else f" {name} " for at, name in enumerate((*ROOT_COLUMNS, *text.angle_names))]
    source.write_bytes(csv_of(some_rows(40), ",".join(names)))
    made = fill(source, weights)
    head, before = made.split(b"\n")[0].decode(), source.read_bytes().split(b"\n")[0].decode()
    cells = [cell.strip().strip('"') for cell in head.split(",")]
    assert not any(cell.startswith(("=", "+", "-", "@")) for cell in cells) and "'" in head
    assert head.replace("'", "") == before.replace("'", "")
    rig = robot_rig(text.urdf(), "t.urdf")
    one, two = read_table(made, "out.csv", rig), read_table(source.read_bytes(), "in.csv", rig)
    assert np.array_equal(one.columns, two.columns) and np.array_equal(one.values[0], two.values[0])
