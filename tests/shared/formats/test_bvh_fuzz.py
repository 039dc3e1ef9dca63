"""Whatever bytes the reader is given: numbers, or an InputError that names the file; nothing else."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.errors import InputError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of, values_of
from stages.shared.formats.bvh_write import write_bvh
from tests.shared.formats.bvh_texts import BvhText

_WHOLE = BvhText(frames=4, placed=("Hips", "LeftHand")).data()
_WORDS = [
    b"{",
    b"}",
    b"ROOT",
    b"JOINT",
    b"OFFSET",
    b"CHANNELS 6",
    b"End Site",
    b"MOTION",
    b"Frames: 3",
    b"nan",
    b"\0",
]
_WORDS += [b"1e308", b"-", b"\r", b"\n", b"\t", b"\xff", b"Xrotation", b"HIERARCHY", b"Frame Time: 1e-9", b"1.2.3"]


def _check(data: bytes, keep: bool) -> None:
    try:
        bvh = read_bvh(data, "fuzz.bvh", keep_unreadable_rows=keep)
    except InputError as error:
        assert "fuzz.bvh" in error.message
        return
    assert bvh.values.shape == (len(bvh.rows), sum(len(joint.channels) for joint in bvh.joints))
    if keep:
        return
    assert np.isfinite(bvh.values).all()
    try:
        skeleton, motion, _ = motion_of(bvh, trim_first="auto")
    except InputError as error:
        assert "fuzz.bvh" in error.message
        return
    assert np.allclose(np.linalg.norm(motion.rotations, axis=-1), 1, atol=1e-3)
    first = bvh.frames - motion.frames
    rows = values_of(bvh, skeleton, motion, bvh.values[first:])
    assert rows.shape == bvh.values[first:].shape


@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(0, len(_WHOLE)), st.integers(0, 60), st.one_of(st.sampled_from(_WORDS), st.binary(max_size=8))
        ),
        min_size=1,
        max_size=4,
    ),
    st.booleans(),
)
def test_mutated_files(edits: list[tuple[int, int, bytes]], keep: bool) -> None:
    data = _WHOLE
    for at, cut, insert in edits:
        data = data[:at] + insert + data[at + cut :]
    _check(data, keep)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=400), st.booleans())
def test_arbitrary_bytes(data: bytes, keep: bool) -> None:
    _check(data, keep)
    _check(b"HIERARCHY\nROOT a\n{\n" + data + b"\nMOTION\nFrames: 1\nFrame Time: 0.1\n" + data, keep)


_NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(_NUMBERS, min_size=6, max_size=6), min_size=1, max_size=5))
def test_numbers_are_read_to_the_last_bit(rows: list[list[float]]) -> None:
    text = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition "
    text += "Zrotation Xrotation Yrotation\n}\n"
    text += f"MOTION\nFrames: {len(rows)}\nFrame Time: 0.1\n"
    text += "\n".join(" ".join(map(repr, row)) for row in rows)
    values = read_bvh(text.encode(), "a").values
    assert np.array_equal(values, np.array(rows))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(["\n", "\r\n"]), st.sampled_from([" ", "\t"]), st.integers(2, 9))
def test_written_files_read_back(seed: int, newline: str, separator: str, frames: int) -> None:
    text = BvhText(frames=frames, seed=seed, newline=newline, separator=separator)
    bvh = read_bvh(text.data(), "a")
    again = read_bvh(write_bvh(bvh, bvh.values), "a")
    assert np.allclose(again.values, bvh.values, atol=1e-6)
    assert (again.header, again.motion_head, again.newline) == (bvh.header, bvh.motion_head, newline)
