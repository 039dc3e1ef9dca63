"""`inspect` tells skeleton, groups, unit, rate and problems, of one file or of all in an archive."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from data_schemas.errors import InputError
from stages.inspect_file.config import Config
from stages.inspect_file.run import run
from tests.formats.bvh_texts import BvhText


def test_one_file(tmp_path: Path) -> None:
    path = tmp_path / "walk.bvh"
    path.write_bytes(BvhText(frames=30, above="joint_Root", declared=31).data())
    report = run(Config(path=str(path)))
    text = "\n".join(report.lines)
    assert "unit 0.01 m, Y up" in text and "30 frames at 30 fps" in text and "pelvis: Hips" in text
    assert "Frames says 31" in text and "(outside the body)" in text
    assert any(line.strip().startswith("LeftForeArm") and "left_arm, 25.0 cm" in line for line in report.lines)
    assert report.figures["unit_m"] == 0.01 and report.figures["tracks"] == ["Hips"]


def test_what_is_no_humanoid_is_still_described(tmp_path: Path) -> None:
    path = tmp_path / "chair.bvh"
    path.write_text(
        "HIERARCHY\nROOT seat\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n}\n"
        "MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n"
    )
    report = run(Config(path=str(path)))
    assert any("no humanoid" in line for line in report.lines) and any("seat" in line for line in report.lines)


def test_jumps_and_stillness_are_problems(tmp_path: Path) -> None:
    text = BvhText(frames=20)
    rows = text.text().split("\n")
    rows[-5] = " ".join(["900", *rows[-5].split(" ")[1:]])
    path = tmp_path / "jump.bvh"
    path.write_text("\n".join(rows))
    assert any("into frame 16, 17" in line for line in run(Config(path=str(path))).lines)
    head, _, body = text.text().partition("0.0333333\n")
    path.write_text(head + "0.0333333\n" + "\n".join([body.split("\n")[0]] * 20) + "\n")
    assert any("Nothing moves" in line for line in run(Config(path=str(path))).lines)


def test_an_archive_in_a_line_each(tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("good.bvh", BvhText().data())
        archive.writestr("bad.bvh", b"HIERARCHY")
    report = run(Config(path=str(path)))
    assert report.figures == {"files": 2, "with_problems": 1}
    assert "unreadable" in report.lines[0] and "21 joints" in report.lines[1]
    assert "21 joints" in run(Config(path=f"{path}!good.bvh")).lines[1]
    with pytest.raises(InputError, match=r"bad\.bvh"):
        run(Config(path=f"{path}!bad.bvh"))
