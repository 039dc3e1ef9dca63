"""`pumps infill` under constraints: kept columns byte for byte, nothing else read, errors that write nothing."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pumps
from data_schemas.errors import InputError, PumpsError, UsageError
from stages.infill.config import Config
from stages.infill.constrained import check_constraints
from stages.infill.part_rows import columns_given
from stages.infill.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.inference.constraints.flags import constraints_of_flags
from stages.shared.inference.constraints.known_parts import known_parts
from tests.infill.test_infill import CLIPS

KEYS = "0,15,40,60"


@pytest.fixture
def source(tmp_path) -> Path:
    path = tmp_path / "in.bvh"
    path.write_bytes((CLIPS / "walk.bvh").read_bytes())
    return path


def fill(source: Path, weights: str, **options) -> bytes:
    output = source.with_name("out.bvh")
    settings = {"points": 48, "device": "cpu", "overwrite": True, **options}
    run(Config(input=source, output=output, weights=weights, **settings))
    return output.read_bytes()


def with_junk(source: Path, asked) -> bytes:
    """The file with other numbers wherever nothing is given, and text in rows of which nothing is given."""
    bvh = read_bvh(source.read_bytes(), "in")
    skeleton, _, _ = motion_of(bvh)
    given = columns_given(bvh, known_parts(asked, skeleton, bvh.frames), skeleton)
    lines = source.read_bytes().split(b"\n")
    first = next(i for i, line in enumerate(lines) if line.startswith(b"Frame Time")) + 1
    for row in range(61):
        words = lines[first + row].split()
        kept = [word if own else b"123.25" for word, own in zip(words, given[row], strict=True)]
        lines[first + row] = b" ".join(kept) if given[row].any() else b"what is this"
    return b"\n".join(lines)


@pytest.mark.parametrize(
    "flags",
    [
        {"keyframes": KEYS, "keep": ("lower_body:all",)},
        {"keyframes": f"{KEYS};arms=22,33", "keep": ("neck,right_knee:5-9",)},
        {"keyframes": "arms=10,40"},
    ],
)
def test_kept_columns_come_back_byte_for_byte_and_others_are_not_read(source, weights, flags):
    asked = constraints_of_flags(flags["keyframes"], keep=flags.get("keep", ()))
    made = fill(source, weights, **flags)
    bvh, out = (read_bvh(data, "file") for data in (source.read_bytes(), made))
    skeleton, _, _ = motion_of(bvh)
    given = columns_given(bvh, known_parts(asked, skeleton, bvh.frames), skeleton)
    assert out.header == bvh.header and out.motion_head == bvh.motion_head
    kept = filled = 0
    for row, columns in enumerate(given):
        for new, old, own in zip(out.rows[row].split(), bvh.rows[row].split(), columns, strict=True):
            kept += own and new == old
            filled += not own and new != old
            assert not own or new == old
    assert kept > 100 and filled > 100
    source.write_bytes(with_junk(source, asked))
    assert fill(source, weights, **flags) == made


def test_curves_of_parts_do_not_jump(source, weights):
    made = read_bvh(fill(source, weights, keyframes=f"{KEYS};arms=22,33", keep=("legs,root:all",)), "file")
    assert np.abs(np.diff(made.values[:61], axis=0)).max() < 180


def test_a_file_of_constraints_does_what_flags_do(source, weights, tmp_path):
    asked = {"keyframes": KEYS, "keep": [{"part": "legs", "frames": "all"}], "locks": [{"part": "neck"}]}
    (tmp_path / "c.json").write_text(json.dumps(asked))
    by_flags = fill(source, weights, keyframes=KEYS, keep=("legs:all",), lock=("neck",))
    assert fill(source, weights, constraints=tmp_path / "c.json") == by_flags
    motion = pumps.load(source)
    options = {"weights": weights, "points": 48, "device": "cpu"}
    in_python = pumps.infill(motion, KEYS, keep={"legs": "all"}, lock={"neck": "all"}, **options)
    assert in_python.source == by_flags
    assert pumps.infill(motion, constraints=asked, **options).source == by_flags
    assert any("legs are kept" in note for note in in_python.notes)


def test_pins_and_a_path_in_the_file(source, weights, tmp_path):
    (tmp_path / "path.csv").write_text("frame,x,z\n" + "".join(f"{f},{f / 100},0.05\n" for f in range(16, 40)))
    motion = pumps.load(source)
    pelvis = motion.positions[:, 0]
    wanted = {frame: (pelvis[frame, 0], pelvis[frame, 2] + 0.02) for frame in (18, 30)}
    made = pumps.infill(motion, KEYS, path=wanted, pins={"left_foot": "44-56"}, weights=weights, points=48)
    ankle = made.positions[44:57, made.names.index("left_ankle")]
    assert np.ptp(ankle, axis=0).max() < 0.005
    for frame, place in wanted.items():
        assert np.abs(made.positions[frame, 0, [0, 2]] - place).max() < 1e-3
    assert fill(source, weights, keyframes=KEYS, path=tmp_path / "path.csv")


def test_constraints_at_any_rate_and_with_frames_added(source, weights):
    made = fill(source, weights, keyframes="0,30,60:", keep=("arms:all",), predict=10, fps_override=47.5)
    assert len(read_bvh(made, "file").rows) == len(read_bvh(source.read_bytes(), "file").rows) + 10


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"keyframes": KEYS, "keep": ("wings:all",)}, "wings"),
        ({"keyframes": KEYS, "keep": ("legs:0-500",)}, "0-500"),
        ({"keyframes": KEYS, "pin": ("right_hand:0-40",)}, "right_hand"),
        ({"keyframes": KEYS, "pin": ("right_hand:3-5",), "lock": ("arms",)}, "locked"),
        ({"keyframes": "legs=0,9;arms=0,9", "transition": "3:9"}, "transition"),
        ({"frames": "0,5", "keep": ("legs:all",)}, "frames"),
        ({"keep": ("legs:all",)}, "keys"),
        ({"pin": ("left_foot:3-5",)}, "keys"),
        ({"keyframes": KEYS, "keep": ("upper_body,lower_body:all",)}, "nothing to fill"),
        ({"keyframes": KEYS, "constraints": Path("missing.json")}, "missing.json"),
    ],
)
def test_bad_constraints_write_nothing(source, weights, options, said):
    with pytest.raises(PumpsError, match=said) as error:
        fill(source, weights, **options)
    assert isinstance(error.value, (InputError, UsageError))
    assert not source.with_name("out.bvh").exists()


def test_a_robots_angles_take_no_constraints():
    with pytest.raises(InputError, match="robot"):
        check_constraints(constraints_of_flags("0,5", locks=["neck"]), ".csv")
    check_constraints(constraints_of_flags("0,5"), ".csv")
