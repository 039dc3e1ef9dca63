"""Names in CSV files: no formula to a spreadsheet, and read back as they were."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stages.export.config import Config
from stages.export.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.positions_csv import read_csv
from stages.shared.formats.table_write import csv_of_motion
from stages.shared.formats.text_cells import text_cell, text_of_cell, texts_of_line
from tests.shared.formats.bvh_texts import BvhText

FORMULAS = ("=1+1", "+1", "-1", "@SUM(1)", "\t=1", "\r=1", "=cmd|'/C calc'!A", "－1", "＝1")
QUOTED = ("'=1", "''+1")
OTHERS = ("Hips", "'quoted'", "a,b", 'a"b', '"', "a;b", "mixamorig:Hips", "左手", "a=b", "''")


@pytest.mark.parametrize("text", [*FORMULAS, *QUOTED, *OTHERS])
def test_a_text_comes_back(text: str) -> None:
    assert text_of_cell(text_cell(text)) == text
    assert text_cell(text)[0] not in "=+-@\t\r＝－"


@pytest.mark.parametrize("text", OTHERS)
def test_other_texts_stay_as_they_are(text: str) -> None:
    assert text_cell(text) == text


@pytest.mark.parametrize("text", QUOTED)
def test_a_quoted_formula_gets_another_apostrophe(text: str) -> None:
    assert text_cell(text) == f"'{text}"


def test_names_of_a_table_come_back_and_its_numbers_stay() -> None:
    skeleton, motion, _ = motion_of(read_bvh(BvhText(frames=8).data(), "walk.bvh"))
    ends = [text.strip() for text in (*FORMULAS, *QUOTED, *OTHERS)]
    names = tuple(f"{ends[n % len(ends)]} {name}" for n, name in enumerate(skeleton.names))
    data = csv_of_motion(replace(skeleton, names=names), motion, "positions")
    plain = csv_of_motion(skeleton, motion, "positions")
    assert data.split(b"\n", 1)[1] == plain.split(b"\n", 1)[1]
    for cell in next(csv.reader(io.StringIO(data.decode()))):
        assert cell[0] not in "=+-@\t\r＝－"
    found = read_csv(data, "walk.csv")
    assert found.names == names and np.array_equal(found.places, read_csv(plain, "walk.csv").places)


def test_a_recordings_formulas_do_not_reach_the_table(tmp_path: Path) -> None:
    text = BvhText(frames=8, names={"LeftHand": "=cmd|'/C_calc'!A", "RightHand": "@SUM(1+1)*cmd"})
    (tmp_path / "evil.bvh").write_bytes(text.data())
    run(Config(input=str(tmp_path / "evil.bvh"), output=tmp_path / "evil.csv", values="positions"))
    header = (tmp_path / "evil.csv").read_text().splitlines()[0]
    cells = next(csv.reader([header]))
    assert "'=cmd|'/C_calc'!A.x" in cells and "'@SUM(1+1)*cmd.z" in cells
    assert not any(cell.startswith(("=", "+", "-", "@")) for cell in cells)
    assert "=cmd|'/C_calc'!A" in read_csv((tmp_path / "evil.csv").read_bytes(), "evil.csv").names


@pytest.mark.parametrize("line", ['"' * 300_000, '"' + "a" * 300_000, '"a' * 200_000, "a\rb,c", "\0,b", ""])
def test_an_odd_line_is_cells_too(line: str) -> None:
    assert isinstance(texts_of_line(line, ","), list)
