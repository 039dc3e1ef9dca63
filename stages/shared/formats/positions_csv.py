"""Reading a text table of joint positions: column names (`Hips.x`, `Hips_y`, `Hips:Z`), then one line per frame."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Flag, note
from stages.shared.formats.measured_positions import MeasuredPositions
from stages.shared.formats.recording import MAX_JOINTS
from stages.shared.formats.table_columns import (
    DECIMAL_COMMAS,
    PLACE,
    column_named,
    decimal_commas_hint,
    separator_of,
)
from stages.shared.formats.text_cells import texts_of_line

_TIMES = ("time", "t", "times", "timestamp", "seconds", "time_s", "time (s)", "time [s]")
_COUNTS = ("frame", "frames", "index", "frame_index", "frame#", "")
_MOST_COLUMNS = 8 * MAX_JOINTS  # places and quaternions of all joints


def read_csv(data: bytes, name: str) -> MeasuredPositions:
    """The places of a table, NaN for empty cells, and the rate if there is a column of times.

    Columns of rotations beside those of places are left out, with a note.

    Raises: InputError naming the line and the column; a table of rotations alone is refused.
    """
    lines = lines_of(data)
    head = next(lines, (1, ""))[1].removeprefix("\ufeff")
    separator = separator_of(head)
    columns = texts_of_line(head, separator)
    if len(columns) > _MOST_COLUMNS:
        raise InputError(f"{name} has {len(columns)} columns; pumps reads at most {_MOST_COLUMNS}.")
    names, order, time, others = _meaning(columns, name)
    numbers = array("d")  # lists of rows would take ten times the memory of the text
    for number, line in lines:
        numbers.extend(_row(line, separator, len(columns), f"{name}, line {number}"))
    values = np.frombuffer(numbers, np.float64).reshape(-1, len(columns))
    if not len(values):
        raise InputError(f"{name} has no rows.")
    fps = rate_of_times(values[:, time], name) if time is not None and len(values) > 1 else None
    places = values[:, order].reshape(len(values), len(names), 3)
    places[~np.isfinite(places)] = np.nan
    left_out = (note(Flag.ROTATIONS_LEFT_OUT, columns=others),) if others else ()
    return MeasuredPositions(places, names, fps=fps, notes=left_out)


def lines_of(data: bytes) -> Iterator[tuple[int, str]]:
    """Lines that are not blank, with their numbers from 1."""
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    start, number = 0, 0
    while start < len(data):
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        number += 1
        line = data[start:end].decode("utf-8", errors="replace")
        if line.strip():
            yield number, line
        start = end + 1


def _meaning(columns: list[str], name: str) -> tuple[tuple[str, ...], list[int], int | None, int]:
    """Joints' names, the columns of their x, y and z, the column of times, and how many are of other kinds."""
    found: dict[str, dict[str, int]] = {}
    time = None
    others: list[tuple[str, str]] = []
    for index, cell in enumerate(columns):
        if cell.lower() in _TIMES:
            time = index
            continue
        if cell.lower() in _COUNTS:
            continue
        column = column_named(cell)
        if column is None:
            raise InputError(f"{name}, line 1: '{cell[:60]}' is not a column of a place, such as Hips.x.")
        if column.kind != PLACE:
            others.append((cell, column.kind))
            continue
        axes = found.setdefault(column.joint, {})
        if column.axis in axes:
            raise InputError(f"{name}, line 1: the column '{cell[:60]}' stands twice.")
        axes[column.axis] = index
    if others and not found:
        raise InputError(
            f"{name}, line 1: '{others[0][0][:60]}' holds {others[0][1]}, and no column holds a place.",
            "Export the places of joints (columns such as Hips.x), or the motion as BVH or GLB.",
        )
    if not found:
        raise InputError(f"{name}, line 1: there are no columns such as Hips.x.", "Is it a table of joint positions?")
    for joint, axes in found.items():
        if set(axes) != set("xyz"):
            raise InputError(
                f"{name}, line 1: joint '{joint[:60]}' has {', '.join(sorted(axes))} and needs x, y and z."
            )
    if len(found) > MAX_JOINTS:
        raise InputError(f"{name} has {len(found)} joints, and {MAX_JOINTS} are the most.")
    return tuple(found), [axes[axis] for axes in found.values() for axis in "xyz"], time, len(others)


def _row(line: str, separator: str, count: int, where: str) -> list[float]:
    cells = [cell.strip().strip('"') for cell in line.split(separator)]
    if len(cells) != count:
        # "1,5,2,5" is two numbers whose decimals are written with commas.
        doubled = separator == "," and count > 1 and len(cells) > 1.5 * count
        raise InputError(
            f"{where}: {len(cells)} cells where there are {count} columns.", DECIMAL_COMMAS if doubled else None
        )
    if separator == ";":
        cells = [cell.replace(",", ".") for cell in cells]  # as spreadsheets write where commas are decimal points
    return numbers_of(cells, where)


def numbers_of(cells: list[str], where: str) -> list[float]:
    """The cells as numbers, NaN for empty ones. Raises InputError naming the first cell that is not a number."""
    try:
        return [float(cell) if cell else math.nan for cell in cells]
    except ValueError:
        bad = next(cell for cell in cells if cell and not _is_number(cell))
        raise InputError(f"{where}: '{bad[:40]}' is not a number.", decimal_commas_hint(bad)) from None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def rate_of_times(times: np.ndarray, name: str) -> float:
    """Frames per second of a column of times (T,) in seconds. Raises InputError if they do not go up evenly."""
    steps = np.diff(times)
    step = float(np.median(steps)) if np.isfinite(steps).all() else float("nan")
    if not 1e-4 <= step <= 10:
        raise InputError(
            f"{name}: its times are not seconds that go up.", "Leave the column out and give --fps-override."
        )
    if np.abs(steps - step).max() > 0.5 * step:
        raise InputError(f"{name}: its times go up unevenly, by {steps.min():g} to {steps.max():g} seconds.")
    rate = 1.0 / step
    return float(round(rate)) if abs(rate - round(rate)) < 0.02 * rate / 10 else rate
