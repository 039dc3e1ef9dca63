"""`pumps infill` on files: header word for word, keys byte for byte, nothing read between, curves without jumps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from stages.infill.config import Config
from stages.infill.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_rows import layout_of

CLIPS = Path(__file__).resolve().parents[2] / "stages" / "shared" / "clips"
KEYS = "0,15,40,60"


@pytest.fixture
def source(tmp_path) -> Path:
    path = tmp_path / "in.bvh"
    path.write_bytes((CLIPS / "walk.bvh").read_bytes())
    return path


def fill(source: Path, weights: str, **options) -> bytes:
    options = {"points": 48, "device": "cpu", "overwrite": True, **options}
    output = source.parent / "out.bvh"
    run(Config(input=source, output=output, weights=weights, **options))
    assert sorted(p.name for p in source.parent.iterdir()) == ["in.bvh", "out.bvh"]
    return output.read_bytes()


def rows_of(data: bytes) -> list[bytes]:
    return read_bvh(data, "file").rows


def test_header_keys_and_outside_come_back_word_for_word(source, weights):
    made = fill(source, weights, keyframes="10,15,40,60")
    original = source.read_bytes()
    cut = original.index(b"MOTION")
    assert made[:cut] == original[:cut]
    before, after = rows_of(original), rows_of(made)
    assert len(before) == len(after)
    head = read_bvh(original, "file").motion_head
    assert read_bvh(made, "file").motion_head == head
    for row in [*range(11), 15, 40, *range(60, len(before))]:
        assert after[row] == before[row]
    changed = [row for row in range(10, 60) if after[row] != before[row]]
    assert len(changed) == 47  # all but the inner keys


def test_junk_between_keys_changes_no_byte(source, weights):
    clean = fill(source, weights, keyframes=KEYS)
    lines = source.read_bytes().split(b"\n")
    first = next(i for i, line in enumerate(lines) if line.startswith(b"Frame Time")) + 1
    for i, junk in enumerate((b"nan", b"0 0 0", b"1e30 " * 200, b"what is this", b"-99999 " * 34)):
        lines[first + 3 + 7 * i] = junk
    source.write_bytes(b"\n".join(lines))
    assert fill(source, weights, keyframes=KEYS) == clean


def test_independent_reader_sees_the_same_keys(source, weights):
    bvhio = pytest.importorskip("bvhio")
    fill(source, weights, keyframes=KEYS)
    ours = bvhio.readAsBvh(str(source.parent / "out.bvh"))
    theirs = bvhio.readAsBvh(str(source))
    assert ours.FrameCount == theirs.FrameCount and ours.FrameTime == theirs.FrameTime
    named = [(joint.Name, joint) for joint, _, _ in ours.Root.layout()]
    other = [(joint.Name, joint) for joint, _, _ in theirs.Root.layout()]
    assert [name for name, _ in named] == [name for name, _ in other]
    for (_, a), (_, b) in zip(named, other, strict=True):
        for key in (0, 15, 40, 60):
            assert a.Keyframes[key].Rotation == b.Keyframes[key].Rotation
            assert a.Keyframes[key].Position == b.Keyframes[key].Position


def test_newlines_and_encoding_stay(source, weights):
    text = source.read_bytes().replace(b"ROOT root", "ROOT Hüfte".encode("latin-1")).replace(b"\n", b"\r\n")
    source.write_bytes(text)
    made = fill(source, weights, keyframes=KEYS)
    cut = text.index(b"MOTION")
    assert made[:cut] == text[:cut]
    assert made.count(b"\r\n") == made.count(b"\n")


def turning_file(source: Path, wrap: bool) -> None:
    """Make the root turn about Y at 6 degrees a frame, written within +-180 degrees if `wrap`."""
    bvh = read_bvh(source.read_bytes(), "file")
    lines = source.read_bytes().split(b"\n")
    first = next(i for i, line in enumerate(lines) if line.startswith(b"Frame Time")) + 1
    order = [c for c in bvh.joints[0].channels if "rotation" in c]
    columns = {c[0]: bvh.joints[0].first_channel + bvh.joints[0].channels.index(c) for c in order}
    for row, values in enumerate(bvh.values.copy()):
        angle = 120.0 + 6.0 * row
        values[columns["Y"]] = (angle + 180.0) % 360.0 - 180.0 if wrap else angle
        values[columns["X"]] = values[columns["Z"]] = 0.0
        lines[first + row] = " ".join(f"{v:.4f}" for v in values).encode()
    source.write_bytes(b"\n".join(lines))


@pytest.mark.parametrize("wrap", [False, True])
def test_curves_do_not_jump_beside_keys(source, weights, wrap):
    turning_file(source, wrap)
    made = read_bvh(fill(source, weights, keyframes=KEYS), "file")
    keys = [0, 15, 40, 60]
    angles = np.concatenate([c.ravel() for order, _, c in layout_of(made.joints).rotations if order])
    steps = np.abs(np.diff(made.values[:61, angles], axis=0)).max(axis=1)
    beside = sorted({k for key in keys for k in (key - 1, key) if 0 <= k < 60})
    assert steps[beside].max() < 180
    if not wrap:
        assert steps.max() < 180


def test_transition_and_prediction(source, weights):
    before = rows_of(source.read_bytes())
    after = rows_of(fill(source, weights, transition="30:60"))
    assert after[:30] == before[:30] and after[60:] == before[60:]
    assert all(a != b for a, b in zip(after[30:60], before[30:60], strict=True))
    made = fill(source, weights, predict=12)
    after = rows_of(made)
    assert after[: len(before)] == before and len(after) == len(before) + 12
    assert read_bvh(made, "file").declared_frames == len(before) + 12
    jumps = np.abs(np.diff(read_bvh(made, "file").values[len(before) - 1 :], axis=0)).max()
    assert np.isfinite(jumps) and jumps < 180


def test_sparse_keys_give_the_same_frames(source, weights):
    dense = rows_of(fill(source, weights, keyframes="0,15,40"))[:41]
    bvh = read_bvh(source.read_bytes(), "file")
    keys = [bvh.rows[i] for i in (0, 15, 40)]
    head = source.read_bytes()[: source.read_bytes().index(b"MOTION")]
    source.write_bytes(head + b"MOTION\nFrames: 3\nFrame Time: 0.0333333\n" + b"\n".join(keys) + b"\n")
    by_frame = fill(source, weights, frames="0,15,40")
    by_time = fill(source, weights, times="0, 0.5 1.3333")
    assert rows_of(by_frame) == rows_of(by_time) == dense
    assert read_bvh(by_frame, "file").declared_frames == 41
    late = rows_of(fill(source, weights, frames="2,15,40"))
    assert late[:3] == [keys[0]] * 3


def test_other_rates_key_rows_and_summary(source, weights):
    text = source.read_bytes()
    start = text.index(b"Frame Time")
    source.write_bytes(text[:start] + b"Frame Time: 0.008333" + text[text.index(b"\n", start) :])
    output = source.parent / "out.bvh"
    report = run(Config(input=source, output=output, weights=weights, keyframes="every:60", points=48, device="cpu"))
    before, after = rows_of(source.read_bytes()), rows_of(output.read_bytes())
    assert len(before) == len(after)
    assert all(after[k] == before[k] for k in [*range(0, len(before), 60), len(before) - 1])
    text = "\n".join(report.lines)
    assert "longest gap is 0.50 s" in text and "Velocity jump" in text
    assert f"licences: test only (pumps weights show {weights})." in text
    assert "plain interpolation" in text
    assert report.figures["velocity_jumps"] and report.figures["filled"] == len(before) - report.figures["keys"]


def test_long_gap_is_warned_of(source, weights):
    output = source.parent / "out.bvh"
    report = run(Config(input=source, output=output, weights=weights, keyframes="0,60", points=48, device="cpu"))
    assert any("trained on gaps of up to 1.07 s" in line for line in report.lines)


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"keyframes": "0,900"}, InputError, "0,900|900"),
        ({"keyframes": "0:10"}, UsageError, "nothing to fill"),
        ({"keyframes": ":"}, UsageError, "nothing to fill"),
        ({}, UsageError, "Nothing says"),
        ({"keyframes": "0,9", "transition": "3:5"}, UsageError, "both"),
        ({"keyframes": "0,9", "predict": 5}, UsageError, "last key"),
        ({"predict": 0}, UsageError, "predict"),
        ({"frames": "0,1"}, InputError, "rows"),
        ({"times": "soon"}, UsageError, "list of numbers"),
        ({"keyframes": "0,9", "weights": "no-such"}, InputError, "no weights"),
        ({"keyframes": "0,9", "fps_override": 0.0}, UsageError, "frame rate"),
    ],
)
def test_refusals(source, weights, options, error, says):
    with pytest.raises(error, match=says):
        fill(source, options.pop("weights", weights), **options)
    assert [p.name for p in source.parent.iterdir()] == ["in.bvh"]


def test_key_rows_must_be_readable_and_outputs_are_not_overwritten(source, weights):
    output = source.parent / "out.bvh"
    output.write_text("mine")
    with pytest.raises(UsageError, match="exists"):
        run(Config(input=source, output=output, weights=weights, keyframes=KEYS))
    lines = source.read_bytes().split(b"\n")
    first = next(i for i, line in enumerate(lines) if line.startswith(b"Frame Time")) + 1
    lines[first + 15] = b"1 2 3"
    source.write_bytes(b"\n".join(lines))
    with pytest.raises(InputError, match="row 15"):
        run(Config(input=source, output=output, weights=weights, keyframes=KEYS, overwrite=True))
    assert output.read_text() == "mine"
    with pytest.raises(InputError, match="cannot be read"):
        run(Config(input=source.parent / "none.bvh", output=output, weights=weights, keyframes=KEYS, overwrite=True))


def test_feet_are_held_unless_told_otherwise_and_keys_stay(source, weights):
    loose = fill(source, weights, keyframes="every:15", foot_lock=False)
    held = fill(source, weights, keyframes="every:15")
    before, after = rows_of(loose), rows_of(held)
    last = len(before) - 1
    assert all(before[row] == after[row] for row in [*range(0, last, 15), last])
    assert before != after
    original = rows_of(source.read_bytes())
    part = rows_of(fill(source, weights, keyframes="10,25,40"))
    assert all(part[row] == original[row] for row in [*range(11), 25, *range(40, len(original))])


def test_the_summary_tells_how_feet_slide(source, weights):
    output = source.parent / "out.bvh"
    told = {}
    for lock in (False, True):
        config = Config(input=source, output=output, weights=weights, keyframes="every:15", foot_lock=lock,
                        points=48, device="cpu", overwrite=True)  # fmt: skip
        report = run(config)
        (line,) = (line for line in report.lines if line.startswith("Foot skate"))
        assert ("before the feet were held" in line) == lock
        told[lock] = report.figures
    assert told[True]["foot_skate_mps"] < 0.7 * told[False]["foot_skate_mps"]
    assert told[True]["plain_foot_skate_mps"] == told[False]["plain_foot_skate_mps"] > 0
