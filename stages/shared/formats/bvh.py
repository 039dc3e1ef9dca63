"""Reading BVH: the variants found in public data, numbers parsed by NumPy, errors that name joint and line.

Values are kept as in the file (degrees, the file's unit and axes); `stages.shared.formats.bvh_motion` converts them
to a Motion. Header and rows are kept verbatim, so that a file can be written back with only some rows changed.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.formats.bvh_header import BvhJoint, HeaderFault, parse_header
from stages.shared.formats.number_rows import TextRows, lines_of, plain_rows
from stages.shared.formats.table_columns import decimal_commas_hint

__all__ = ["BvhFile", "BvhJoint", "read_bvh"]

MAX_HEADER_BYTES = 4 << 20
_MOTION = re.compile(rb"(?:^|[\r\n])[ \t]*MOTION[ \t]*(?=[\r\n])", re.IGNORECASE)
_LONGEST_COUNTS = 4096  # bytes of the MOTION, Frames and Frame Time lines


@dataclass(frozen=True)
class BvhFile:
    """The content of a BVH file.

    header:          text up to and excluding the MOTION line, newlines as found.
    motion_head:     text of the MOTION, Frames and Frame Time lines, as found, up to the first row.
    joints:          in the header's order; the channels of joint j start at column `first_channel`.
    frame_time:      seconds, as written. declared_frames: as written.
    values:          (T, C) float64 in the file's unit and degrees; NaN in unreadable rows (if they are kept).
    rows:            T verbatim lines without their newline.
    newline:         of the rows: "\\n", "\\r\\n" or "\\r". encoding: of header and motion_head.
    warnings:        faults of the file that were corrected.
    """

    name: str
    header: str
    motion_head: str
    joints: tuple[BvhJoint, ...]
    frame_time: float
    declared_frames: int
    values: np.ndarray
    rows: Sequence[bytes] = field(repr=False)
    newline: str = "\n"
    encoding: str = "utf-8"
    warnings: list[Note] = field(default_factory=list)

    @property
    def frames(self) -> int:
        return self.values.shape[0]

    def select(self, frames: np.ndarray) -> BvhFile:
        """The same file with only the rows of `frames` (K,) int, in that order."""
        index = np.asarray(frames, dtype=np.int64)
        return replace(self, values=self.values[index], rows=[self.rows[i] for i in index])


def read_bvh(data: bytes, name: str, *, keep_unreadable_rows: bool = False) -> BvhFile:
    """Parse a BVH.

    Args:
        data: the file's bytes.
        name: the file's name in error messages.
        keep_unreadable_rows: return NaN for rows without valid numbers instead of refusing the file (for infill,
            where the rows between keys may hold anything).
    Raises: InputError naming file, line and joint.
    """
    header_bytes = _header_of(data, name)
    header, encoding = _decode(header_bytes, name)
    try:
        joints = parse_header(header)
    except HeaderFault as fault:
        raise InputError(f"{name}, line {fault.line}: {fault.message}.", fault.hint) from None
    first_line = _line_count(header_bytes) + 1
    counts = data[len(header_bytes) : len(header_bytes) + _LONGEST_COUNTS]
    declared, frame_time, cut = _counts(counts, name, first_line)
    motion_head = counts[:cut]
    columns = sum(len(joint.channels) for joint in joints)
    begin = len(header_bytes) + cut
    newline = _newline_of(data, begin) or _newline_of(motion_head) or "\n"
    place = _Place(name, joints, first_line + _line_count(motion_head))
    rows, values, lines = _parse_rows(data, begin, newline.encode(), columns, place, keep_unreadable_rows, declared)
    notes = _check_frames(name, declared, len(rows))
    if lines != len(rows):
        notes.append(note(Flag.ROWS_JOINED, lines=lines, rows=len(rows)))
    return BvhFile(
        name=name,
        header=header,
        motion_head=motion_head.decode(encoding),
        joints=joints,
        frame_time=frame_time,
        declared_frames=declared,
        values=values,
        rows=rows,
        newline=newline,
        encoding=encoding,
        warnings=notes,
    )


def _newline_of(text: bytes, start: int = 0) -> str | None:
    """The ending of a text's first line after `start`. Header and rows may differ if two programs wrote the file."""
    at = text.find(b"\n", start)
    if at < 0:
        return "\r" if text.find(b"\r", start) >= 0 else None
    return "\r\n" if at > start and text[at - 1 : at] == b"\r" else "\n"


def _line_count(data: bytes) -> int:
    return data.count(b"\n") or data.count(b"\r")


def _header_of(data: bytes, name: str) -> bytes:
    """The bytes before the MOTION line. Raises InputError if there are none."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4096]:
        raise InputError(f"{name} is not plain text.", "Save it as UTF-8 or ASCII.")
    if not data or data.isspace():
        raise InputError(f"{name} is empty.")
    match = _MOTION.search(data, 0, MAX_HEADER_BYTES)
    if match is None:
        if b"HIERARCHY" not in data[:4096].upper():
            raise InputError(f"{name}, line 1: expected HIERARCHY.", "Is this a BVH file?")
        raise InputError(f"{name} has no MOTION line.", "Is the file truncated?")
    start = match.start() + (data[match.start() : match.start() + 1] in (b"\r", b"\n"))
    return data[:start]


def _decode(header: bytes, name: str) -> tuple[str, str]:
    """Header text and its encoding; Latin-1 decodes any bytes and encodes them back unchanged."""
    try:
        return header.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        return header.decode("latin-1"), "latin-1"


def _counts(text: bytes, name: str, line: int) -> tuple[int, float, int]:
    """Declared frames, frame time, and the offset of the first row, of a text that begins with the MOTION line."""
    lines = text.splitlines(keepends=True)
    written = [at for at, each in enumerate(lines) if each.strip()][:3]  # MOTION, Frames and Frame Time
    frames_text = _value_after((b"Frames",), lines[written[1]]) if len(written) == 3 else None
    time_text = _value_after((b"Frame", b"Time"), lines[written[2]]) if len(written) == 3 else None
    if frames_text is None or time_text is None:
        raise InputError(f"{name}, line {line + 1}: expected 'Frames: N' and 'Frame Time: SECONDS' after MOTION.")
    if not re.fullmatch(rb"\d{1,18}", frames_text):
        found = frames_text.decode("latin-1")[:40]
        raise InputError(f"{name}, line {line + 1}: Frames is '{found}' and must be a whole number.")
    try:
        frame_time = float(time_text)
    except ValueError:
        frame_time = float("nan")
    if not 1e-4 <= frame_time <= 10.0:  # NaN fails too
        raise InputError(
            f"{name}, line {line + 2}: Frame Time is '{time_text.decode('latin-1')[:40]}'"
            " and must be seconds between 0.0001 and 10.",
            decimal_commas_hint(time_text.decode("latin-1")) or "Write 1 divided by the frames per second.",
        )
    return int(frames_text), frame_time, sum(map(len, lines[: written[2] + 1]))


def _value_after(words: tuple[bytes, ...], line: bytes) -> bytes | None:
    """The word after `words` and a colon; empty if nothing follows it, None if the line does not begin with them."""
    rest = line.strip()
    for word in words:
        if rest[: len(word)].lower() != word.lower():
            return None
        rest = rest[len(word) :].lstrip(b" \t")
    found = rest.removeprefix(b":").split()
    return b"".join(found) if len(found) < 2 else None


@dataclass(frozen=True)
class _Place:
    """Names of a file's joints and lines, for errors about a row."""

    name: str
    joints: tuple[BvhJoint, ...]
    first_line: int

    def joint_of(self, column: int) -> str:
        for joint in self.joints:
            if joint.first_channel <= column < joint.first_channel + len(joint.channels):
                return f"{joint.channels[column - joint.first_channel]} of joint '{joint.name}'"
        return "no channel"


def _parse_rows(
    data: bytes, begin: int, newline: bytes, columns: int, place: _Place, keep_unreadable: bool, declared: int
) -> tuple[Sequence[bytes], np.ndarray, int]:
    """Rows and their numbers (T, C) of the text that begins at `begin`, and the number of its lines that are not
    blank: a row may be broken into lines, or a line may hold several rows."""
    plain = plain_rows(data, begin, newline, columns)
    if plain is not None and (keep_unreadable or np.isfinite(plain).all()):
        return TextRows(data, begin, newline, len(plain)), plain, len(plain)
    lines = list(lines_of(data, begin, newline))
    rows = [line for _, line in lines]
    starts = [place.first_line + number for number, _ in lines]
    values, bad = _fill_values(rows, columns)
    if bad and not keep_unreadable:
        unwrapped = _unwrap_rows(rows, starts, columns, declared)
        if unwrapped is None:
            raise _row_error(rows[bad[0]], columns, place, starts[bad[0]], last=bad[0] == len(rows) - 1)
        rows, starts = unwrapped
        values, bad = _fill_values(rows, columns)
        if bad:
            raise _row_error(rows[bad[0]], columns, place, starts[bad[0]])
    values[bad] = np.nan
    if not keep_unreadable and not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise InputError(
            f"{place.name}, line {starts[row]}: {place.joint_of(column)} in frame {row} is {values[row, column]},"
            " not a finite number."
        )
    return rows, values, len(lines)


def _fill_values(rows: list[bytes], columns: int) -> tuple[np.ndarray, list[int]]:
    """Numbers of all rows, (T, C) float64, and the indices of rows that do not hold exactly C numbers."""
    values = np.empty((len(rows), columns))
    bad: list[int] = []
    parse = np.fromstring  # text mode: the fastest number parser at hand, exact to the last bit
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy's sign that a word was not a number
        for i, row in enumerate(rows):
            try:
                values[i] = parse(row, dtype=np.float64, count=-1, sep=" ").reshape(columns)
            except (ValueError, DeprecationWarning):  # noqa: PERF203
                values[i] = np.nan
                bad.append(i)
    return values, bad


def _unwrap_rows(
    lines: list[bytes], starts: list[int], columns: int, declared: int
) -> tuple[list[bytes], list[int]] | None:
    """Rows of C words of a file that breaks them into lines regularly, and the line on which each begins.

    Breaks are regular if every row begins on a new line, if a line holds several whole rows, or if all lines have the
    same length of at most half a row. Returns None for other breaks, so that a row that lacks a number never takes
    one from the next row.
    """
    words = [line.split() for line in lines]
    counts = [len(each) for each in words]
    total = sum(counts)
    if not total or total % columns:
        return None
    one_length = len(set(counts[:-1])) == 1 and counts[-1] <= counts[0] <= columns // 2
    if not (_rows_begin_on_lines(counts, columns) or (one_length and total == declared * columns)):
        return None
    flat = [(word, at) for each, at in zip(words, starts, strict=True) for word in each]
    rows = [flat[i : i + columns] for i in range(0, total, columns)]
    return [b" ".join(word for word, _ in row) for row in rows], [row[0][1] for row in rows]


def _rows_begin_on_lines(counts: list[int], columns: int) -> bool:
    """True if every line of `counts` words holds whole rows of C words or a part of one row."""
    held = 0
    for count in counts:
        held += count
        if held in (columns, count) and held % columns == 0:
            held = 0
        elif held > columns:
            return False
    return held == 0


def _row_error(row: bytes, columns: int, place: _Place, line: int, *, last: bool = False) -> InputError:
    words = row.split()
    for column, word in enumerate(words[:columns]):
        if not _is_number(word):
            shown = word.decode("latin-1")[:40]
            return InputError(
                f"{place.name}, line {line}: '{shown}' ({place.joint_of(column)}) is not a number.",
                decimal_commas_hint(shown),
            )
    hint = "Is the file truncated?" if last and len(words) < columns else "Mend the row: one number for each channel."
    return InputError(f"{place.name}, line {line}: {len(words)} values, but {columns} channels are declared.", hint)


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return b"_" not in word


def _check_frames(name: str, declared: int, found: int) -> list[Note]:
    """Refuse a file without frames, or with a wrong frame count; a count that is wrong by one is only reported."""
    if found == 0:
        raise InputError(f"{name} holds no frames.")
    if declared == found:
        return []
    if abs(declared - found) == 1:
        return [note(Flag.FRAMES_LINE_OFF, declared=declared, found=found)]
    raise InputError(
        f"{name}: Frames says {declared} and there are {found} rows.",
        "Is the file truncated?" if found < declared else "Correct the Frames line.",
    )
