"""What the Blender add-on asks of pumps: bones, names, keys, constraints and the command."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest

from stages.shared.inference.constraints.asked import Constraints
from stages.shared.inference.constraints.rig_parts import PARTS
from tests.contrib.rigs import add_on

blender = add_on()


def test_the_largest_tree_is_depth_first() -> None:
    #  0 -> 2 -> 5, 0 -> 3, and a lone 1 -> 4
    assert blender.largest_tree([-1, -1, 0, 0, 1, 2]) == [0, 2, 5, 3]
    assert blender.largest_tree([]) == []
    assert blender.largest_tree([-1, *range(4999)]) == list(range(5000))


def test_names_for_a_bvh_differ_and_have_no_blanks() -> None:
    names = blender.bvh_names(
        ["Bip01 L Thigh", "Bip01_L_Thigh", "a,b", "x{y}", "", "thigh.L", "mixamorig:Hips", "腿"]
    )
    assert names == ["Bip01_L_Thigh", "Bip01_L_Thigh_2", "a_b", "x_y_", "bone", "thigh.L", "mixamorig:Hips", "腿"]


def test_no_joint_has_the_name_of_a_part() -> None:
    assert not set(blender.bvh_names(PARTS)) & set(PARTS)


@pytest.mark.parametrize(
    ("path", "bone"),
    [
        ('pose.bones["Hips"].location', "Hips"),
        ('pose.bones["a \\"b\\" \\\\"].rotation_quaternion', 'a "b" \\'),
        ('pose.bones["Hips"].rotation_euler', "Hips"),
        ('pose.bones["Hips"]["property"]', None),
        ('pose.bones["Hips"].constraints["IK"].influence', None),
        ('pose.bones["Hips"].bbone_curveinx', None),
        ("location", None),
    ],
)
def test_bones_of_curves(path: str, bone: str | None) -> None:
    assert blender.bone_of_path(path) == bone


def test_keys_in_the_range() -> None:
    assert blender.key_frames([1.0, 24.0, 12.0, 12.2, 90.0, -3.0], 1, 50) == [1, 12, 24]


@pytest.mark.parametrize(("times", "sentence"), [([], "0 keys"), ([3, 3], "1 keys"), ([3, 4, 5], "Every frame")])
def test_nothing_to_fill_is_refused(times: list[float], sentence: str) -> None:
    with pytest.raises(blender.Refused, match=sentence):
        blender.key_frames(times, 1, 50)


def test_constraints_are_those_of_pumps() -> None:
    whole = Constraints(**json.loads(blender.constraints_of([0, 12, 24])))
    assert whole.keyframes == "0,12,24" and not whole.any
    some = Constraints(**json.loads(blender.constraints_of([0, 12], ["Arm.L", "Hand.L"])))
    assert some.keyframes is None and some.parts[0].part == "Arm.L,Hand.L" and some.parts[0].frames == "0,12"


def program(folder: Path, lines: str) -> str:
    """A program that stands for pumps."""
    path = folder / "stand-in"
    path.write_text(f"#!{sys.executable}\nimport pathlib, sys, time\n{lines}\n")
    path.chmod(0o755)
    return str(path)


def ended(run) -> None:
    until = time.monotonic() + 20
    while not run.ended():
        assert time.monotonic() < until
        time.sleep(0.01)


def test_a_run_sends_files_and_words_and_leaves_nothing(tmp_path: Path) -> None:
    lines = "pathlib.Path('filled.bvh').write_text(pathlib.Path('sent.bvh').read_text() + str(sys.argv[1:]))"
    run = blender.Run(program(tmp_path, lines), "text; $(touch x)", "{}", ["--weights", "a b; $HOME"], 20)
    ended(run)
    assert run.result() == "text; $(touch x)" + str(
        ["infill", "sent.bvh", "--constraints", "keys.json", "--weights", "a b; $HOME", "-o", "filled.bvh"]
    )
    assert {each.name for each in run.folder.iterdir()} == {"sent.bvh", "keys.json", "said.txt", "filled.bvh"}
    run.close()
    assert not run.folder.exists()


def test_the_error_of_pumps_is_shown(tmp_path: Path) -> None:
    run = blender.Run(program(tmp_path, "sys.exit('pumps: no weights.')"), "", "{}", [], 20)
    ended(run)
    with pytest.raises(blender.Refused, match=r"^pumps: no weights\.$"):
        run.result()
    run.close()


def test_cancel_ends_the_program(tmp_path: Path) -> None:
    run = blender.Run(program(tmp_path, "time.sleep(60)"), "", "{}", [], 20)
    assert not run.ended()
    run.close()
    assert run.process.poll() is not None and not run.folder.exists()


def test_a_run_that_takes_too_long_is_refused(tmp_path: Path) -> None:
    run = blender.Run(program(tmp_path, "time.sleep(60)"), "", "{}", [], 0.05)
    with pytest.raises(blender.Refused, match=r"longer than 0\.05 s"):
        ended(run)
    run.close()
    assert run.process.poll() is not None


def test_a_program_that_is_not_there_is_refused() -> None:
    with pytest.raises(blender.Refused, match=r"does not start .* preferences"):
        blender.Run("no-such-pumps", "", "{}", [], 20)
