"""Reading a text table of joint positions: column names (`Hips.x`, `Hips_y`, `Hips:Z`), then one line per frame."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterator

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.recording import MAX_JOINTS
from stages.shared.formats.text_cells import texts_of_line

_AXIS = re.compile(r"^(?P<joint>.+?)[\s._:/-]*\(?(?P<axis>[xyzXYZ])\)?\s*(?:[\[(][^\])]*[\])])?$")
_TIMES = ("time", "t", "times", "timestamp", "seconds", "time_s", "time (s)", "time [s]")
_COUNTS = ("frame", "frames", "index", "frame_index", "")


def read_csv(data: bytes, name: str) -> tuple[tuple[str, ...], np.ndarray, float | None]:
    """Names, places (T, J, 3) with NaN for empty cells, and the rate if there is a column of times.

    Raises: InputError naming the line and the column.
    """
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    lines = _lines(data)
    head = next(lines, (1, ""))[1].removeprefix("\ufeff")
    separator = max((";", "\t", ","), key=head.count)
    columns = texts_of_line(head, separator)
    if len(columns) > 3 * MAX_JOINTS + 2:
        raise InputError(f"{name} has {len(columns)} columns; pumps reads at most {3 * MAX_JOINTS}.")
    names, order, time = _meaning(columns, name)
    numbers = array("d")  # lists of rows would take ten times the memory of the text
    for number, line in lines:
        numbers.extend(_row(line, separator, len(columns), f"{name}, line {number}"))
    values = np.frombuffer(numbers, np.float64).reshape(-1, len(columns))
    if not len(values):
        raise InputError(f"{name} has no rows.")
    fps = _rate(values[:, time], name) if time is not None and len(values) > 1 else None
    places = values[:, order].reshape(len(values), len(names), 3)
    places[~np.isfinite(places)] = np.nan
    return names, places, fps


def _lines(data: bytes) -> Iterator[tuple[int, str]]:
    """Lines that are not blank, with their numbers from 1."""
    start, number = 0, 0
    while start < len(data):
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        number += 1
        line = data[start:end].decode("utf-8", errors="replace")
        if line.strip():
            yield number, line
        start = end + 1


def _meaning(columns: list[str], name: str) -> tuple[tuple[str, ...], list[int], int | None]:
    """Joints' names, the columns of x, y and z of each, and the column of times."""
    found: dict[str, dict[str, int]] = {}
    time = None
    for index, column in enumerate(columns):
        match = _AXIS.match(column)
        if column.lower() in _TIMES:
            time = index
        elif match:
            axes = found.setdefault(match["joint"], {})
            if match["axis"].lower() in axes:
                raise InputError(f"{name}, line 1: the column '{column[:60]}' stands twice.")
            axes[match["axis"].lower()] = index
        elif column.lower() not in _COUNTS:
            raise InputError(f"{name}, line 1: '{column[:60]}' is not a column of a place, such as Hips.x.")
    if not found:
        raise InputError(f"{name}, line 1: there are no columns such as Hips.x.", "Is it a table of joint positions?")
    for joint, axes in found.items():
        if set(axes) != set("xyz"):
            raise InputError(
                f"{name}, line 1: joint '{joint[:60]}' has {', '.join(sorted(axes))} and needs x, y and z."
            )
    return tuple(found), [axes[axis] for axes in found.values() for axis in "xyz"], time


def _row(line: str, separator: str, count: int, where: str) -> list[float]:
    if line.count(separator) != count - 1:
        raise InputError(f"{where}: {line.count(separator) + 1} cells where there are {count} columns.")
    if separator == ";":
        line = line.replace(",", ".")  # as spreadsheets write where commas are decimal points
    cells = [cell.strip().strip('"') for cell in line.split(separator)]
    try:
        return [float(cell) if cell else math.nan for cell in cells]
    except ValueError:
        bad = next(cell for cell in cells if cell and not _is_number(cell))
        raise InputError(f"{where}: '{bad[:40]}' is not a number.") from None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _rate(times: np.ndarray, name: str) -> float:
    """Frames per second of a column of times in seconds."""
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
