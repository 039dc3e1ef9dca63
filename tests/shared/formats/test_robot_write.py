"""Joint angles written: the rows that were read, from whatever carried the motion; lines kept byte for byte."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.errors import InputError
from stages.shared.formats.bvh_motion import read_bvh_motion
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.robot_csv import read_robot_csv
from stages.shared.formats.robot_rig import RobotRig, robot_rig
from stages.shared.formats.robot_table import ROOT_COLUMNS, read_table, table_with_rows
from stages.shared.formats.robot_write import csv_of_rows, notes_of_rows, rows_of_motion
from tests.shared.formats.robot_files import ANGLES, RobotText, csv_of, some_rows

RIG = robot_rig(RobotText().urdf(), "t.urdf")


def _read(data: bytes) -> Recording:
    (recording,) = read_robot_csv(data, "t.csv", Asked(rig=RobotText().urdf(), rig_name="t.urdf"))
    return recording


def _written(recording: Recording, rig: RobotRig = RIG, **options: bool) -> np.ndarray:
    return rows_of_motion(rig, recording.skeleton, recording.motion, "t", **options).values


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), frames=st.integers(2, 40), far=st.floats(0, 50))
def test_rows_come_back_through_a_motion(seed: int, frames: int, far: float) -> None:
    rows = some_rows(frames, seed=seed)
    rows[:, :2] += far
    data = csv_of(rows)
    made = csv_of_rows(_written(_read(data)))
    wanted, found = (read_table(text, "t.csv", RIG).values for text in (data, made))
    wanted[:, 3:7] *= np.sign((wanted[:, 3:7] * found[:, 3:7]).sum(axis=1, keepdims=True))
    assert np.abs(wanted - found).max() < 1e-5 + 1e-7 * far
    again = csv_of_rows(_written(_read(made)))
    assert np.abs(read_table(again, "t.csv", RIG).values - found).max() < 1e-5 + 1e-7 * far


def test_rows_come_back_through_a_bvh() -> None:
    rows = some_rows(30)
    recording = _read(csv_of(rows))
    text = bvh_of_motion(recording.skeleton, recording.motion, "t")
    (bvh,) = read_bvh_motion(text, "t.bvh", Asked())
    assert np.abs(_written(bvh) - rows).max() < 1e-5


def test_another_skeleton_is_refused_with_what_differs() -> None:
    recording = _read(csv_of(some_rows()))
    skeleton = recording.skeleton
    renamed = replace(skeleton, names=tuple(name.replace("left_knee", "knie") for name in skeleton.names))
    moved = replace(skeleton, offsets=skeleton.offsets * 1.2)
    for other, words in ((renamed, "no joint left_knee"), (moved, "mm from where the robot has it")):
        with pytest.raises(InputError) as caught:
            _written(replace(recording, skeleton=other))
        assert words in caught.value.message and "retarget" in (caught.value.hint or "")


def test_limits_and_hinges_are_reported() -> None:
    recording = _read(csv_of(some_rows(30)))
    narrow = robot_rig(RobotText(limits=(-0.2, 0.3)).urdf(), "t.urdf")
    free = rows_of_motion(narrow, recording.skeleton, recording.motion, "t")
    held = rows_of_motion(narrow, recording.skeleton, recording.motion, "t", limited=True)
    assert "--respect-limits" in notes_of_rows(narrow, free, limited=False)[0]
    assert "held at a limit" in notes_of_rows(narrow, held, limited=True)[0]
    assert held.values[:, 7:][:, :4].max() <= 0.3 and free.values[:, 7:][:, :4].max() > 0.3
    assert notes_of_rows(RIG, rows_of_motion(RIG, recording.skeleton, recording.motion, "t"), limited=False) == []
    rotations = recording.motion.rotations.copy()
    rotations[5:9, 3] = [0, 0.6, 0, 0.8]
    turned = replace(recording.motion, rotations=rotations)
    (note,) = notes_of_rows(RIG, rows_of_motion(RIG, recording.skeleton, turned, "t"), limited=False)[:1]
    assert "4 of 30 frames joints turn about other axes" in note


NAMES = ["frame", *ROOT_COLUMNS, *ANGLES]
TABLES = {
    "plain": {},
    "dos": {"newline": "\r\n"},
    "tabs": {"separator": "\t"},
    "old-mac": {"newline": "\r"},
    "names": {"header": ",".join([*ROOT_COLUMNS, *ANGLES])},
}


@pytest.mark.parametrize("options", TABLES.values(), ids=TABLES)
def test_kept_lines_are_kept_and_others_spelled_alike(options: dict) -> None:
    rows = some_rows(9)
    data = csv_of(rows, **options)
    table = read_table(data, "t.csv", RIG)
    kept = {frame: frame for frame in (0, 4, 8)}
    assert table_with_rows(table, np.zeros_like(rows), {i: i for i in range(9)}, kept) == data
    made = table_with_rows(table, rows, kept, kept)
    assert made == data
    other = table_with_rows(table, rows + 0.5, kept, kept)
    newline = options.get("newline", "\n").encode()
    before, after = data.split(newline), other.split(newline)
    first = 1 if "header" in options else 0
    same = [i - first for i, (a, b) in enumerate(zip(before, after, strict=True)) if a == b]
    assert [i for i in same if 0 <= i < 9] == [0, 4, 8]


def test_counters_of_frames_go_on() -> None:
    rows = np.hstack([np.arange(100, 109)[:, None], some_rows(9)])
    table = read_table(csv_of(rows, ",".join(NAMES)), "t.csv", RIG)
    keys = {0: 0, 4: 4}
    made = read_table(table_with_rows(table, np.ones((12, 7 + len(ANGLES))), keys, keys), "t.csv", RIG,
                      keep_unreadable_rows=True)  # fmt: skip
    assert made.raw[:, 0].tolist() == list(range(100, 112))


def test_decimal_commas_stay() -> None:
    data = csv_of(some_rows(5), separator=";").replace(b".", b",")
    table = read_table(data, "t.csv", RIG)
    keys = {0: 0, 4: 4}
    assert table_with_rows(table, table.values, keys, keys) == data
