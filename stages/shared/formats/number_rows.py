"""Rows of plain numbers parsed by pyarrow's CSV reader, several times as fast as row by row, to the same bits.

Most programs write plain files: rows of numbers with one space between them. For any other file the result is None,
and the caller reads it with its own parser, which also names faults.
"""

from __future__ import annotations

import numpy as np

WORTH_BYTES = 64_000  # importing pyarrow takes longer than parsing a shorter text


def plain_rows(rows: list[bytes], columns: int) -> np.ndarray | None:
    """Numbers (T, C) float64 of T rows of C numbers separated by single spaces, or None if the rows are not plain.

    A row may end with a space. Values are rounded correctly. `nan` and `inf` are numbers here, as for `float`.
    """
    if not columns or sum(map(len, rows)) < WORTH_BYTES:
        return None
    rows = [row[:-1] if row.endswith(b" ") else row for row in rows]
    if any(row.count(b" ") != columns - 1 for row in rows):
        return None
    import pyarrow as pa
    from pyarrow import csv

    # All numbers as one column: a column for each channel costs more than the parsing where a clip is short.
    text = b"\n".join(rows).replace(b" ", b"\n")
    try:
        table = csv.read_csv(
            pa.BufferReader(text),
            csv.ReadOptions(use_threads=False, column_names=["number"], block_size=len(text)),
            csv.ParseOptions(delimiter="\t", quote_char=False, double_quote=False, ignore_empty_lines=False),
            csv.ConvertOptions(column_types={"number": pa.float64()}, null_values=[], strings_can_be_null=False),
        )
    except pa.ArrowInvalid:
        return None
    numbers = table.column(0)
    if numbers.null_count or len(numbers) != len(rows) * columns:
        return None
    return np.array(numbers.to_numpy()).reshape(len(rows), columns)  # a copy: Arrow's own memory is read-only
