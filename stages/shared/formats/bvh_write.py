"""Writing a BVH back: the header verbatim, chosen rows byte for byte, the others from numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from data_schemas.errors import PumpsError
from stages.shared.formats.bvh import BvhFile

DECIMALS = 6
_ROWS_AT_ONCE = 512  # whose numbers are Python's at once, which take much memory
_FRAME_TIME_LINE = re.compile(r"(Frame[ \t]*Time[ \t:]*)[^ \t:]\S*", re.IGNORECASE)
_FRAMES_LINE = re.compile(r"(Frames[ \t:]*)\d+", re.IGNORECASE)


def write_bvh(
    bvh: BvhFile,
    values: np.ndarray,
    verbatim_rows: Mapping[int, int] | None = None,
    frame_count: int | None = None,
    *,
    frame_time: float | None = None,
    decimals: int = DECIMALS,
    verbatim_columns: Mapping[int, np.ndarray] | None = None,
) -> bytes:
    """The bytes of a BVH with the header of another one.

    Args:
        bvh: the source of the header, the Frames and Frame Time lines, the newline and the verbatim rows.
        values: (T, C) in the file's unit and degrees; verbatim rows are ignored.
        verbatim_rows: frame to write -> row of `bvh` to copy byte for byte.
        frame_count: number of rows to write, T by default. The Frames line is changed only if this number differs
            from the number of rows in `bvh` (a file whose Frames line is wrong by one keeps that line).
        verbatim_columns: frame to write -> (C,) bool, the columns that are copied byte for byte from the same row of
            `bvh`; the others come from `values`.
        frame_time: seconds, if the rows have another rate than the file; None keeps the file's line.
    Raises: PumpsError if a value is not finite or the shapes do not match.
    """
    copied = verbatim_rows or {}
    count = len(values) if frame_count is None else frame_count
    columns = sum(len(joint.channels) for joint in bvh.joints)
    if values.shape != (count, columns):
        raise PumpsError(f"{bvh.name}: the rows to write have the shape {values.shape}, expected {(count, columns)}.")
    made = [frame for frame in range(count) if frame not in copied]
    if not np.asarray(np.isfinite(values).all(axis=1))[made].all():
        raise PumpsError(f"{bvh.name}: a value to write is not finite.")
    head = bvh.motion_head
    if count != bvh.frames:
        head = with_frame_count(head, count)
    if frame_time is not None:
        head = _FRAME_TIME_LINE.sub(lambda match: f"{match[1]}{frame_time:.9g}", head, count=1)
    rows: list[bytes] = [b""] * count
    for first in range(0, len(made), _ROWS_AT_ONCE):
        some = made[first : first + _ROWS_AT_ONCE]
        for frame, row in zip(some, format_rows(values[some], decimals), strict=True):
            rows[frame] = row
    for frame, columns in (verbatim_columns or {}).items():
        made_row, kept_row = rows[frame].split(), bvh.rows[frame].split()
        chosen = zip(made_row, kept_row, columns, strict=True)
        rows[frame] = b" ".join(kept if copy else new for new, kept, copy in chosen)
    for frame, row in copied.items():
        if frame < count:
            rows[frame] = bvh.rows[row]
    rows = rows or [b""]
    rows[0] = bvh.header.encode(bvh.encoding) + head.encode(bvh.encoding) + rows[0]
    rows.append(b"")  # for a newline after the last row
    return bvh.newline.encode().join(rows)


def with_frame_count(motion_head: str, count: int) -> str:
    """The text of the MOTION, Frames and Frame Time lines with another number of frames."""
    return _FRAMES_LINE.sub(lambda match: f"{match[1]}{count}", motion_head, count=1)


def format_rows(values: np.ndarray, decimals: int = DECIMALS) -> list[bytes]:
    """Rows (T, C) as text with the given number of decimals."""
    pattern = " ".join([f"%.{decimals}f"] * values.shape[1])
    rounded = np.round(values, decimals) + 0.0  # + 0.0 turns -0.0 into 0.0
    return [(pattern % tuple(row)).encode() for row in rounded.tolist()]
