"""Rows of plain numbers: pyarrow's parser gives the careful parser's bits, and leaves to it what is not plain."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.formats import number_rows
from stages.shared.formats.bvh import _fill_values
from stages.shared.formats.number_rows import TextRows, lines_of, plain_rows

NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:.6f}"),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:.17g}"),
    st.sampled_from(["0", "-0", "-0.0", "1e-14", "1E+05", "5e-324", "1.7976931348623157e308", "00.5", "1.", ".5"]),
)


@pytest.fixture(autouse=True)
def every_length_is_worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(number_rows, "WORTH_BYTES", 0)


def parsed(rows: list[bytes], columns: int, newline: bytes = b"\n") -> np.ndarray | None:
    """The numbers of rows, behind text that is not theirs, so that offsets count."""
    return plain_rows(b"MOTION" + newline.join(rows), len(b"MOTION"), newline, columns)


@settings(max_examples=200, deadline=None)
@given(
    st.integers(1, 5).flatmap(
        lambda columns: st.lists(st.lists(NUMBERS, min_size=columns, max_size=columns), min_size=1)
    ),
    st.sampled_from([b"\n", b"\r\n", b"\r"]),
    st.sampled_from(["", " ", "\t"]),
    st.sampled_from(["", " ", " \t "]),
    st.sampled_from([" ", "  ", "\t"]),
    st.integers(1, 200),
)
def test_the_bits_are_those_of_the_careful_parser(
    cells: list[list[str]], newline: bytes, before: str, after: str, between: str, block: int
) -> None:
    rows = [(before + between.join(row) + after).encode() for row in cells]
    careful, bad = _fill_values(rows, len(cells[0]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(number_rows, "_BLOCK_BYTES", block)
        plain = parsed(rows, len(cells[0]), newline)
        with_end = parsed([*rows, b""], len(cells[0]), newline)
        with_blank_lines = parsed([b"", *rows, b" ", b""], len(cells[0]), newline)
    assert not bad
    for found in (plain, with_end, with_blank_lines):
        assert found is not None and found.tobytes() == careful.tobytes()


@pytest.mark.parametrize(
    "rows",
    [
        [b"1 2", b"3"], [b"1 2", b"3 4 5"], [b"1 x"], [b"1 0x1"], [b"1 1_0"], [b"1 2 3", b"4"], [b"1", b"2 3 4"],
        [b"1 1,5"], [b'1 "2"'], [b"1 \xff"], [b"1 2\n3"], [b"1 -"], [b"1 nul"], [b"1\x002"], [b"1\x1f2 3"],
        [b"1 2\n3 4", b"5"], [b"1 2 3 4"], [b"1 ", b"2"],
    ],
)  # fmt: skip
def test_what_is_not_plain_is_left_to_the_careful_parser(rows: list[bytes]) -> None:
    assert parsed(rows, 2) is None


def test_a_text_without_rows_has_no_rows() -> None:
    found = parsed([b"", b" ", b""], 2)
    assert found is not None and found.shape == (0, 2)


def test_a_line_longer_than_a_block_is_one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(number_rows, "_BLOCK_BYTES", 16)
    found = parsed([b" ".join(b"%d" % (row + i) for i in range(40)) for row in range(3)], 40)
    assert found is not None and np.array_equal(found, np.arange(40) + np.arange(3)[:, None])


def test_few_bytes_take_little_memory_however_many_channels_are_declared() -> None:
    assert parsed([b"1 2"] * 1000, 10**9) is None


def test_rows_are_split_when_they_are_asked_for() -> None:
    data = b"MOTION\n\n1 2\r\n \r\n3 4 \r\n"
    rows = TextRows(data, 7, b"\r\n", 2)
    assert len(rows) == 2 and rows == [b"1 2", b"3 4 "] and rows[1] == b"3 4 " and rows[-2:] == [b"1 2", b"3 4 "]
    assert list(lines_of(data, 7, b"\r\n")) == [(1, b"1 2"), (3, b"3 4 ")]


def test_short_files_do_not_load_pyarrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert parsed([b"1 2"] * 100, 2) is None


def test_parsing_takes_the_array_and_a_few_blocks_of_memory() -> None:
    row = b" ".join(b"%.6f" % value for value in np.random.default_rng(0).uniform(-180, 180, 96)) + b"\n"
    data = row * 10_000
    parsed([row[:-1]], 96)  # imports pyarrow
    tracemalloc.start()
    try:
        found = plain_rows(data, 0, b"\n", 96)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found is not None and found.nbytes == 96 * 8 * 10_000
    assert peak < found.nbytes + 12 * number_rows._BLOCK_BYTES
