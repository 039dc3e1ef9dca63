"""Rows of plain numbers: pyarrow's parser gives the careful parser's bits, and leaves to it what is not plain."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.formats import number_rows
from stages.shared.formats.bvh import _fill_values
from stages.shared.formats.number_rows import plain_rows

NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:.6f}"),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:.17g}"),
    st.sampled_from(["0", "-0", "-0.0", "1e-14", "1E+05", "5e-324", "1.7976931348623157e308", "00.5", "1.", ".5"]),
)


@pytest.fixture(autouse=True)
def every_length_is_worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(number_rows, "WORTH_BYTES", 0)


@settings(max_examples=200, deadline=None)
@given(
    st.integers(1, 5).flatmap(
        lambda columns: st.lists(st.lists(NUMBERS, min_size=columns, max_size=columns), min_size=1)
    )
)
def test_the_bits_are_those_of_the_careful_parser(cells: list[list[str]]) -> None:
    rows = [" ".join(row).encode() for row in cells]
    careful, bad = _fill_values(rows, len(cells[0]))
    plain = plain_rows(rows, len(cells[0]))
    assert not bad and plain is not None and plain.tobytes() == careful.tobytes()


def test_a_space_at_the_end_of_a_row_does_not_matter() -> None:
    found = plain_rows([b"1 2 ", b"3 4"], 2)
    assert found is not None and found.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    "rows",
    [
        [b"1  2"], [b" 1 2"], [b"1\t2"], [b"1 2", b"3"], [b"1 2", b"3 4 5"], [b"1 x"], [b"1 0x1"], [b"1 1_0"],
        [b"1 1,5"], [b'1 "2"'], [b"1 2  "], [b""], [b"1 \xff"], [b"1 2\n3"], [b"1 -"], [b"1 nul"],
    ],
)  # fmt: skip
def test_what_is_not_plain_is_left_to_the_careful_parser(rows: list[bytes]) -> None:
    assert plain_rows(rows, 2) is None


def test_a_carriage_return_at_the_end_is_read_as_the_careful_parser_reads_it() -> None:
    found, (careful, bad) = plain_rows([b"1 2\r"], 2), _fill_values([b"1 2\r"], 2)
    assert found is not None and not bad and found.tobytes() == careful.tobytes()


def test_short_files_do_not_load_pyarrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert plain_rows([b"1 2"] * 100, 2) is None
