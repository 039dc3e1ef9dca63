"""Rows of numbers in a text, parsed by pyarrow in blocks: several times as fast as row by row, to the same bits.

Most programs write plain files: rows of as many numbers as there are channels, separated by white space. For any
other file the result is None, and the caller reads it with its own parser, which also names faults.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, count
from typing import Any, overload

import numpy as np

WORTH_BYTES = 64_000  # importing pyarrow takes longer than parsing a shorter text
_BLOCK_BYTES = 1 << 19  # a block and its arrays fit into a processor's cache
_WHITE = b" \t\n\r\v\f"
_IS_WHITE = np.isin(np.arange(256), list(_WHITE))


class TextRows(Sequence[bytes]):
    """The lines of a text that are not blank, without their newline. Where they begin and end is found when a row is
    asked for; the text is not copied.

    Args:
        data: the text begins at `start` and goes to the end. newline: "\\n", "\\r\\n" or "\\r". count: how many rows.
    """

    def __init__(self, data: bytes, start: int, newline: bytes, count: int):
        self._text, self._newline, self._count = (data, start), newline, count
        self._places: np.ndarray | None = None  # (T, 2), first and last (excluded) byte of each line

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> bytes: ...
    @overload
    def __getitem__(self, index: slice) -> list[bytes]: ...
    def __getitem__(self, index: int | slice) -> bytes | list[bytes]:
        if self._places is None:
            found = (place for _, *place in _places_of(*self._text, self._newline))
            self._places = np.fromiter(chain.from_iterable(found), np.int64).reshape(-1, 2)
        data, places = self._text[0], self._places[index]
        if places.ndim == 1:
            return data[places[0] : places[1]]
        return [data[first:last] for first, last in places.tolist()]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)


def lines_of(data: bytes, start: int, newline: bytes) -> Iterator[tuple[int, bytes]]:
    """Number, from 0, and text without its newline of each line that is not blank."""
    return ((number, data[first:last]) for number, first, last in _places_of(data, start, newline))


def _places_of(data: bytes, start: int, newline: bytes) -> Iterator[tuple[int, int, int]]:
    """As `lines_of`, with the first and last (excluded) byte of each line in place of its text."""
    end = b"\r" if newline == b"\r" else b"\n"
    for number in count():
        stop = data.find(end, start)
        last = len(data) if stop < 0 else stop
        if start < last and not data[start:last].isspace():
            cut = newline == b"\r\n" and data.endswith(b"\r", start, last)
            yield number, start, last - cut
        if stop < 0:
            return
        start = stop + 1


def plain_rows(data: bytes, start: int, newline: bytes, columns: int) -> np.ndarray | None:
    """Numbers (T, C) float64 of a text in which each line that is not blank holds C numbers, or None for other texts.

    Values are rounded correctly. `nan` and `inf` are numbers here, as for `float`.

    Args:
        data: the text begins at `start` and goes to the end. newline: "\\n", "\\r\\n" or "\\r".
    """
    stop = len(data)
    if not columns or stop - start < WORTH_BYTES:
        return None
    end = b"\r" if newline == b"\r" else b"\n"
    most = min(data.count(end, start) + 1, (stop - start + 1) // (2 * columns))
    values = np.empty((most, columns))
    filled = 0
    while start < stop:
        cut = _end_of_block(data, start, end)
        numbers = _numbers(data[start:cut], end, columns)
        if numbers is None:
            return None
        values[filled : filled + len(numbers)] = numbers
        start, filled = cut, filled + len(numbers)
    return values[:filled]


def _end_of_block(data: bytes, start: int, newline: bytes) -> int:
    """Where a block of whole lines ends that begins at `start`: after a newline, or at the end of the text."""
    if len(data) - start <= _BLOCK_BYTES:
        return len(data)
    cut = data.rfind(newline, start, start + _BLOCK_BYTES)
    return (cut if cut >= 0 else data.find(newline, start)) + 1 or len(data)


def _numbers(text: bytes, newline: bytes, columns: int) -> np.ndarray | None:
    """Numbers (T, C) of whole lines, or None if a line has another count of words, or a word is no plain number."""
    if not text.endswith(newline):
        text += newline
    codes = np.frombuffer(text, np.uint8)
    at = np.flatnonzero(codes <= 32)
    ends = np.zeros(len(at) + 1, np.int32)  # of words, in the text without white space
    np.subtract(at, np.arange(len(at)), out=ends[1:], casting="unsafe")
    is_word = ends[1:] > ends[:-1]  # not so between two bytes of white space
    if not _is_regular(codes[at], is_word, newline[0], columns):
        return None
    if not is_word.all():
        ends = ends[np.concatenate([[True], is_word])]
    import pyarrow as pa

    buffers = [None, pa.py_buffer(ends), pa.py_buffer(text.translate(None, _WHITE))]
    words: Any = pa.Array.from_buffers(pa.string(), len(ends) - 1, buffers)
    try:
        return words.cast(pa.float64()).to_numpy().reshape(-1, columns)
    except pa.ArrowInvalid:
        return None


def _is_regular(white: np.ndarray, is_word: np.ndarray, newline: int, columns: int) -> bool:
    """Whether each line holds C words or none.

    Args:
        white: (N,) the bytes up to 32 of a text of whole lines. is_word: (N,) whether a word ends at each.
    """
    if not len(white) % columns and is_word.all():  # one byte between words in all lines: the usual file
        rows = white.reshape(-1, columns)
        if (rows[:, -1] == newline).all() and (rows[:, :-1] == ord(" ")).all():
            return True
    words = np.cumsum(is_word)[white == newline]
    counts = np.diff(words, prepend=0)
    return bool(_IS_WHITE[white].all() and ((counts == 0) | (counts == columns)).all())
