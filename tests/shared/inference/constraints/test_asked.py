"""Constraints as they are asked for: flags, files and dictionaries mean the same; bad ones are one error."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_schemas.errors import InputError, UsageError
from stages.shared.inference.constraints.asked import Constraints, RootPath
from stages.shared.inference.constraints.constraint_files import constraints_of, read_constraints, read_path
from stages.shared.inference.constraints.flags import constraints_of_flags
from stages.shared.inference.constraints.frame_ranges import name_and_frames, parse_frames

IN_JSON = {
    "version": 1,
    "keyframes": "0,40",
    "parts": [{"part": "arms", "frames": "0,20,40"}],
    "keep": [{"part": "legs", "frames": "all"}, {"part": "mixamorig:Head", "frames": "10-12"}],
    "pins": [{"end": "right_hand", "frames": "10-30"}],
    "path": {"frames": [0, 40], "places": [[0.0, 0.0], [1.0, 2.0]]},
    "locks": [{"part": "neck", "frames": "all"}],
}


def test_flags_and_a_file_mean_the_same(tmp_path):
    (tmp_path / "path.csv").write_text("frame,x,z\n0,0,0\n40,1,2\n")
    (tmp_path / "c.json").write_text(json.dumps(IN_JSON))
    flags = constraints_of_flags(
        "0,40;arms=0,20,40",
        keep=["legs:all", "mixamorig:Head:10-12"],
        pins=["right_hand:10-30"],
        path=read_path(tmp_path / "path.csv"),
        locks=["neck"],
    )
    assert read_constraints(tmp_path / "c.json") == (flags, [])
    assert constraints_of(IN_JSON) == flags


@given(st.lists(st.integers(0, 59), min_size=1, max_size=8))
def test_numbers_and_ranges_name_their_frames(numbers):
    text = ",".join(map(str, numbers))
    assert parse_frames(text, 60, "keep").tolist() == sorted(set(numbers))
    first, last = min(numbers), max(numbers)
    assert parse_frames(f"{first}-{last}", 60, "keep").tolist() == list(range(first, last + 1))


def test_all_and_slices():
    assert np.array_equal(parse_frames("all", 5, "keep"), np.arange(5))
    assert parse_frames("3:,0", 5, "keep").tolist() == [0, 3, 4]
    assert parse_frames("every:3", 8, "keep").tolist() == [0, 3, 6, 7]


@pytest.mark.parametrize(
    ("text", "name", "frames"),
    [
        ("legs:all", "legs", "all"),
        ("mixamorig:LeftArm:0,5", "mixamorig:LeftArm", "0,5"),
        ("a b:10:20", "a b", "10:20"),
    ],
)
def test_a_name_may_hold_a_colon(text, name, frames):
    assert name_and_frames(text, "--keep", "x") == (name, frames)


@pytest.mark.parametrize("text", ["", "legs", ":all", "legs:", "legs:many", "legs:1-x"])
def test_texts_that_are_no_part(text):
    with pytest.raises(UsageError, match="--keep"):
        constraints_of_flags("0,5", keep=[text])


@pytest.mark.parametrize("text", ["=0,5", "arms=", "0,5;10", "arms=0;0;5", ";"])
def test_keyframes_that_cannot_be_read(text):
    with pytest.raises(UsageError, match="keyframes"):
        constraints_of_flags(text)


@pytest.mark.parametrize("text", ["40-50", "60", "10-5"])
def test_frames_outside_the_clip(text):
    with pytest.raises((InputError, UsageError), match="keep legs"):
        parse_frames(text, 45, "keep legs")


def test_what_is_given_twice_is_refused():
    keys, path = Constraints(keyframes="0"), Constraints(path=RootPath(frames=(0,), places=((0.0, 0.0),)))
    for twice in (keys, path):
        with pytest.raises(UsageError):
            twice.joined(twice)
    assert keys.joined(path).any


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "not JSON"),
        ("3", "no constraints"),
        ('{"keeps": []}', "keeps"),
        ('{"version": 2}', "version"),
        ('{"keep": [{"part": "legs", "frames": 3}]}', "keep.0.frames"),
        ('{"path": {"frames": [3, 1], "places": [[0, 0], [0, 0]]}}', "rise"),
        ('{"path": {"frames": [1], "places": [[0, NaN]]}}', "path"),
        ('{"pins": [{"end": "head", "frames": "1", "place": [0, 0, 0], "places": []}]}', "place"),
        ('[{"type": "fullbody", "frame_indices": [3]}]', "fullbody"),
        ('[{"type": "root2d"}]', "frame_indices"),
        ('[{"type": "root2d", "frame_indices": ["a"], "smooth_root_2d": [[0, 0]]}]', "frame"),
    ],
)
def test_files_that_are_no_constraints(tmp_path, content, said):
    path = tmp_path / "c.json"
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        read_constraints(path)


def test_kimodos_path_is_read(tmp_path):
    path = tmp_path / "kimodo.json"
    waypoints = {"type": "root2d", "frame_indices": [30, 0], "smooth_root_2d": [[0.5, 1.0], [0.0, 0.0]]}
    path.write_text(json.dumps([waypoints, {**waypoints, "frame_indices": [60, 90], "global_root_heading": []}]))
    found, notes = read_constraints(path)
    assert found.path is not None and found.path.frames == (0, 30, 60, 90)
    assert found.path.places[1] == (0.5, 1.0)
    assert len(notes) == 1 and "heading" in notes[0]


LONG_CELL = 'frame,x,z\n"' + "0" * 200_000


@pytest.mark.parametrize(
    "content", ["", "x,z\n0,0\n", "frame,x,z\n", "frame,x,z\n0,1\n", "frame,x,z\n0.5,1,1\n", LONG_CELL]
)
def test_tables_that_are_no_path(tmp_path, content):
    (tmp_path / "path.csv").write_text(content)
    with pytest.raises(InputError, match=r"path\.csv"):
        read_path(tmp_path / "path.csv")
