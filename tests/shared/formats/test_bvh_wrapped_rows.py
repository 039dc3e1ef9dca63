"""Rows of a BVH that are broken into lines: regular breaks are undone, and no number moves from row to row."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.errors import InputError
from data_schemas.notes import Flag
from stages.shared.formats.bvh import read_bvh
from tests.shared.formats.bvh_texts import BvhText

FRAMES = 12
TEXT = BvhText(frames=FRAMES).text()
WHOLE = read_bvh(TEXT.encode(), "whole")
COLUMNS = WHOLE.values.shape[1]


def with_lines(lines: list[list[str]]) -> bytes:
    head = TEXT[: TEXT.index("0.0333333") + len("0.0333333")]
    return (head + "\n" + "\n".join(" ".join(line) for line in lines) + "\n").encode()


def words() -> list[list[str]]:
    return [row.decode().split() for row in WHOLE.rows]


def chunks(row: list[str], size: int) -> list[list[str]]:
    return [row[i : i + size] for i in range(0, len(row), size)]


@pytest.mark.parametrize("size", [1, 7, 10, COLUMNS // 2, COLUMNS - 1])
def test_rows_that_each_begin_on_a_new_line_are_put_together(size):
    lines = [part for row in words() for part in chunks(row, size)]
    assert np.array_equal(read_bvh(with_lines(lines), "wrapped").values, WHOLE.values)


@pytest.mark.parametrize("size", [5, 8, 2 * COLUMNS])
def test_lines_of_one_length_are_put_together(size):
    flat = [word for row in words() for word in row]
    assert np.array_equal(read_bvh(with_lines(chunks(flat, size)), "wrapped").values, WHOLE.values)


def test_rows_that_were_put_together_are_reported():
    lines = [part for row in words() for part in chunks(row, 10)]
    (said,) = read_bvh(with_lines(lines), "wrapped").warnings
    assert said.flag is Flag.ROWS_JOINED and f"{FRAMES} rows stand on {len(lines)} lines" in str(said)
    flat = [word for row in words() for word in row]
    (said,) = read_bvh(with_lines(chunks(flat, 2 * COLUMNS)), "two on a line").warnings
    assert f"{FRAMES} rows stand on {FRAMES // 2} lines" in str(said)
    assert WHOLE.warnings == []


@pytest.mark.parametrize("lacking, longer", [(2, 9), (0, 1), (9, 2), (3, 11)])
def test_a_row_that_lacks_a_number_takes_none_of_a_later_row(lacking, longer):
    rows = words()
    rows[lacking].pop()
    rows[longer].append("0.5")
    first = min(lacking, longer)
    with pytest.raises(InputError, match=rf"line {WHOLE_LINE + first}: {len(rows[first])} values"):
        read_bvh(with_lines(rows), "short")


def test_numbers_that_are_not_finite_are_refused_in_wrapped_rows_too():
    rows = words()
    rows[4][COLUMNS - 1] = "nan"
    lines = [part for row in rows for part in chunks(row, 10)]
    with pytest.raises(InputError, match="frame 4 is nan, not a finite number"):
        read_bvh(with_lines(lines), "wrapped")
    lines[7][3] = "word"
    with pytest.raises(InputError, match="is not a number"):
        read_bvh(with_lines(lines), "wrapped")


@pytest.mark.parametrize("where", ["OFFSET", "row", "Frame Time"])
def test_decimal_commas_are_named_with_the_mend(where):
    text = TEXT
    if where == "OFFSET":
        at = text.index("OFFSET", text.index("OFFSET") + 1)
        end = text.index("\n", at)
        text = text[:at] + "OFFSET 0,5 20,25 0" + text[end:]
    elif where == "row":
        head, rows = text[: text.index("0.0333333") + 9], text[text.index("0.0333333") + 9 :]
        text = head + rows.replace(".", ",")
    else:
        text = text.replace("0.0333333", "0,0333333")
    with pytest.raises(InputError) as raised:
        read_bvh(text.encode(), "commas")
    assert "use points" in (raised.value.hint or "")


WHOLE_LINE = TEXT[: TEXT.index("0.0333333")].count("\n") + 2
