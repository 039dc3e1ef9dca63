"""`inspect` reports skeleton, groups, unit, rate and problems of one file or of all files in an archive."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest

from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.skeleton import BODY_GROUPS
from stages.infill.config import Config as InfillConfig
from stages.infill.run import run as infill
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.inspect.config import Config
from stages.inspect.run import run
from tests.shared.formats.bvh_texts import HUMANOID, BvhText


def test_one_file(tmp_path: Path) -> None:
    path = tmp_path / "walk.bvh"
    path.write_bytes(BvhText(frames=30, above="joint_Root", declared=31).data())
    report = run(Config(input=str(path)))
    text = "\n".join(report.lines)
    assert "unit 0.01 m, Y up" in text and "30 frames at 30 fps" in text and "pelvis: Hips" in text
    assert "Frames says 31" in text and "(outside the body)" in text
    assert any(line.strip().startswith("LeftForeArm") and "left_arm, 25.0 cm" in line for line in report.lines)
    assert report.figures["unit_m"] == 0.01 and report.figures["tracks"] == ["Hips"]


def test_everything_found_is_in_the_figures_too(tmp_path: Path) -> None:
    path = tmp_path / "walk.bvh"
    path.write_bytes(BvhText(frames=30, above="joint_Root").data())
    figures = json.loads(run(Config(input=str(path))).model_dump_json())["figures"]
    assert figures["format"] == "bvh" and figures["humanoid"] and figures["seconds"] == pytest.approx(1.0)
    assert figures["facing"] == pytest.approx([0, 0, 1], abs=0.05) and figures["rest_pose"] == "T-pose"
    assert ["LeftForeArm", "RightForeArm"] in figures["pairs"] and len(figures["pairs"]) == 8
    assert (
        figures["end_effectors"]["left_hand"] == "LeftHand" and figures["end_effectors"]["right_foot"] == "RightToe"
    )
    assert figures["groups"]["LeftToe"] == "left_leg" and figures["groups"]["joint_Root"] is None
    assert figures["passes_through"] == ["joint_Root"] and "Head" in figures["sampled"]
    assert figures["position_channels"] == ["joint_Root", "Hips"]
    assert figures["found"]["groups"] == {"value": "5 groups", "how": "names", "sure": 0.99}
    assert "tints" not in json.loads(run(Config(input=str(path))).model_dump_json())


def test_a_map_is_printed_edited_and_used(tmp_path: Path) -> None:
    path, given = tmp_path / "walk.bvh", tmp_path / "map.toml"
    path.write_bytes(BvhText(frames=30).data())
    text = run(Config(input=str(path), map=True)).figures["map"]
    given.write_text(text)
    same = run(Config(input=str(path), skeleton_map=given, map=True)).figures["map"]
    assert same.partition("unit_m")[2] == text.partition("unit_m")[2] and "found by map" in same
    given.write_text(text.replace(', "LeftHand"]', "]").replace("outside = []", 'outside = ["LeftHand"]'))
    report = run(Config(input=str(path), skeleton_map=given))
    assert report.figures["groups"]["LeftHand"] is None and report.figures["found"]["sides"]["how"] == "map"
    given.write_text(text.replace("LeftHand", "Left_Hand"))
    with pytest.raises(InputError, match=r"no joint 'Left_Hand'; is it 'LeftHand'\?"):
        run(Config(input=str(path), skeleton_map=given))
    given.write_text("[chains]\n" + "".join(f'{group} = ["x"]\n' for group in BODY_GROUPS))
    with pytest.raises(InputError, match="no joint 'x'"):
        run(Config(input=str(path), skeleton_map=given))
    with pytest.raises(InputError, match="no joint 'x'"):
        infill(InfillConfig(input=path, output=tmp_path / "o.bvh", keyframes="every:10", skeleton_map=given))
    given.write_text(text.replace('"Hips", "Spine"', '"Spine", "Hips"'))
    with pytest.raises(InputError, match="in spine 'Hips' is not below 'Spine'"):
        run(Config(input=str(path), skeleton_map=given))


def test_ingest_and_infill_use_a_map(tmp_path: Path) -> None:
    """A rig that is not recognised is skipped without a map, and read with one."""
    names = {name: f"b{i}" for i, name in enumerate(("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToe"))}
    path, given = tmp_path / "odd.bvh", tmp_path / "map.toml"
    data = BvhText(names=names).data().replace(b"0.000000 -42.000000 1.000000", b"0 0 0").replace(b"-41.0", b"-01.0")
    path.write_bytes(data)
    with pytest.raises(InputError, match="not a humanoid"):
        run(Config(input=str(path), map=True))
    ends = {"left_arm": ("LeftShoulder", "LeftHand"), "right_arm": ("RightShoulder", "RightHand")}
    ends |= {"spine": ("Hips", "Head"), "left_leg": ("b0", "b3"), "right_leg": ("RightUpLeg", "RightToe")}
    given.write_text("[chains]\n" + "".join(f"{group} = {list(joints)}\n" for group, joints in ends.items()))
    assert run(Config(input=str(path), skeleton_map=given)).figures["groups"]["b2"] == "left_leg"
    other = tmp_path / "other.toml"
    other.write_text("[chains]\n" + "".join(f'{group} = ["x{i}"]\n' for i, group in enumerate(ends)))
    report = ingest(
        IngestConfig(sources=(str(path),), output=tmp_path / "motion", skeleton_map=(other, given), licence="CC0")
    )
    assert report.figures["clips"] == 1 and any(
        "other.toml matches none of the rigs" in line for line in report.lines
    )
    with MotionReader(tmp_path / "motion") as reader:
        assert BODY_GROUPS[reader.skeleton(reader.clips[0].skeleton).groups[14]] == "left_leg"


def test_sides_that_seem_swapped_are_a_problem(tmp_path: Path) -> None:
    names = {
        name: ("Right" + name[4:] if name.startswith("Left") else "Left" + name[5:])
        for name, _, _ in HUMANOID
        if name.startswith(("Left", "Right"))
    }
    path = tmp_path / "swapped.bvh"
    path.write_bytes(BvhText(frames=30, names=names).data())
    assert any("seem to be swapped" in line for line in run(Config(input=str(path))).lines)


def test_what_is_no_humanoid_is_still_described(tmp_path: Path) -> None:
    path = tmp_path / "chair.bvh"
    path.write_text(
        "HIERARCHY\nROOT seat\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n}\n"
        "MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n"
    )
    report = run(Config(input=str(path)))
    assert any("not a humanoid" in line for line in report.lines) and any("seat" in line for line in report.lines)


def test_jumps_and_stillness_are_problems(tmp_path: Path) -> None:
    text = BvhText(frames=20)
    rows = text.text().split("\n")
    rows[-5] = " ".join(["900", *rows[-5].split(" ")[1:]])
    path = tmp_path / "jump.bvh"
    path.write_text("\n".join(rows))
    assert any("into frame 16, 17" in line for line in run(Config(input=str(path))).lines)
    head, _, body = text.text().partition("0.0333333\n")
    path.write_text(head + "0.0333333\n" + "\n".join([body.split("\n")[0]] * 20) + "\n")
    assert any("Nothing moves" in line for line in run(Config(input=str(path))).lines)


def test_an_archive_is_listed_one_line_per_file(tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("good.bvh", BvhText().data())
        archive.writestr("bad.bvh", b"HIERARCHY")
    report = run(Config(input=str(path)))
    assert report.figures == {"files": 2, "with_problems": 1}
    assert "unreadable" in report.lines[0] and "21 joints" in report.lines[1]
    assert "21 joints" in run(Config(input=f"{path}!good.bvh")).lines[1]
    with pytest.raises(InputError, match=r"bad\.bvh"):
        run(Config(input=f"{path}!bad.bvh"))
