"""Written files: the header word for word, verbatim rows byte for byte."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.errors import PumpsError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_write import write_bvh
from tests.shared.formats.bvh_texts import BvhText

SPELLINGS = [BvhText(), BvhText(newline="\r\n", separator="\t"), BvhText(newline="\r", row_end=" ", number="{:.3e}")]


@pytest.mark.parametrize("text", SPELLINGS, ids=["plain", "crlf-tabs", "cr-exponents"])
def test_all_rows_verbatim_is_the_same_file(text: BvhText) -> None:
    bvh = read_bvh(text.data(), "a")
    every = {frame: frame for frame in range(bvh.frames)}
    assert write_bvh(bvh, np.full_like(bvh.values, np.nan), every) == text.data()


def test_header_and_rows_may_end_their_lines_differently() -> None:
    data = BvhText().data()
    cut = data.index(b"MOTION")
    for mixed in (data[:cut].replace(b"\n", b"\r\n") + data[cut:], data[:cut] + data[cut:].replace(b"\n", b"\r\n")):
        bvh = read_bvh(mixed, "a")
        assert write_bvh(bvh, bvh.values, {frame: frame for frame in range(bvh.frames)}) == mixed
        assert np.allclose(bvh.values, BvhText().values(), atol=1e-6)


def test_only_the_other_rows_change() -> None:
    text = BvhText(newline="\r\n")
    bvh = read_bvh(text.data(), "a")
    lines = write_bvh(bvh, np.zeros_like(bvh.values), {0: 0, 7: 3}).split(b"\r\n")
    old = text.data().split(b"\r\n")
    start = len(old) - 1 - bvh.frames
    assert lines[: start + 1] == old[: start + 1] and lines[start + 7] == old[start + 3]
    assert set(lines[start + 1].split(b" ")) == {b"0.000000"}


def test_the_frame_count_changes_only_with_the_frames() -> None:
    bvh = read_bvh(BvhText(declared=13, separator="\t").data(), "a")
    assert b"Frames:\t13\n" in write_bvh(bvh, bvh.values)
    longer = write_bvh(bvh, np.vstack([bvh.values, bvh.values[:3]]))
    assert b"Frames:\t15\n" in longer
    assert read_bvh(longer, "b").frames == 15


def test_values_that_cannot_be_written_are_refused() -> None:
    bvh = read_bvh(BvhText().data(), "a")
    broken = bvh.values.copy()
    broken[3, 4] = np.inf
    with pytest.raises(PumpsError, match="not finite"):
        write_bvh(bvh, broken)
    with pytest.raises(PumpsError, match="shape"):
        write_bvh(bvh, bvh.values[:, :-1])
