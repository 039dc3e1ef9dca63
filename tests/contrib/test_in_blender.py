"""The add-on in Blender's Python module `bpy`, with pumps itself.

`BPY_PYTHON` names a Python that has `bpy`, in an environment of its own; without it these tests are skipped.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.contrib.rigs import ADD_ON

ROOT = Path(__file__).resolve().parents[2]
KEYS = (1, 13, 31)
ARM = ("upper_arm.L", "forearm.L", "hand.L")
pytestmark = pytest.mark.skipif("BPY_PYTHON" not in os.environ, reason="BPY_PYTHON names no Python with bpy")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command `pumps` of this checkout."""
    path = tmp_path_factory.mktemp("bin") / "pumps"
    path.write_text(
        f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(ROOT)!r})\n"
        "from pumps_cli.__main__ import main\nmain()\n"
    )
    path.chmod(0o755)
    return path


def filled(program: Path, case: str) -> dict:
    words = [
        os.environ["BPY_PYTHON"],
        str(Path(__file__).with_name("in_blender.py")),
        str(ADD_ON),
        str(program),
        case,
    ]
    ran = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout.strip().splitlines()[-1])


def moved(said: dict, frame: int, bones: tuple[str, ...] = ()) -> float:
    """The largest difference of a frame's poses before and after: of places in metres, of turns as sines."""
    before, after = said["before"][str(frame)], said["after"][str(frame)]
    return max(np.abs(np.subtract(before[bone], after[bone])).max() for bone in bones or before)


def test_an_action_is_filled_between_its_keys(program: Path) -> None:
    said = filled(program, "whole")
    assert said["outcome"] == ["FINISHED"], said["error"]
    assert said["actions"] == ["Dance", "Dance filled"] and said["new"] == "Dance filled"
    assert said["old_is_unchanged"]
    assert said["keyed"] == list(KEYS)
    for frame in (*KEYS, 32, 40):
        assert moved(said, frame) < 1e-5
    between = [moved(said, frame) for frame in range(1, 31) if frame not in KEYS]
    assert min(between) > 1e-4 and max(between) < 0.5
    assert all(moved(said, frame, ("handle",)) < 1e-6 for frame in range(1, 41))


def test_only_the_selected_bones_are_filled(program: Path) -> None:
    said = filled(program, "arm")
    assert said["outcome"] == ["FINISHED"], said["error"]
    others = tuple(bone for bone in said["before"]["1"] if bone not in ARM)
    assert all(moved(said, frame, others) < 1e-6 for frame in range(1, 41))
    assert all(moved(said, frame) < 1e-5 for frame in KEYS)
    assert max(moved(said, frame, ARM) for frame in range(1, 31)) > 1e-4


def test_what_follows_the_filled_range_stays_as_it_is(program: Path) -> None:
    said = filled(program, "range")
    assert said["outcome"] == ["FINISHED"], said["error"]
    assert said["keyed"] == list(KEYS)
    assert max(moved(said, frame) for frame in (1, *range(13, 41))) < 1e-5


def test_an_action_without_keys_is_refused(program: Path) -> None:
    said = filled(program, "empty")
    assert said["outcome"] == ["CANCELLED"] and "There are 0 keys from frame 1 to 40." in said["error"]


def test_bones_with_constraints_are_refused(program: Path) -> None:
    said = filled(program, "refused")
    assert said["outcome"] == ["CANCELLED"]
    assert "Bone 'forearm.L' has constraints. Bake the action first" in said["error"]
    assert said["new"] == "Dance" and said["actions"] == ["Dance"]
