"""Reading OpenSim's table of markers (.trc), as OpenSim, Pose2Sim and Cortex write it.

Five lines of head: the file's type; the names of its facts; the facts (DataRate, NumFrames, NumMarkers, Units, ...);
`Frame#`, `Time` and a name for every three columns; `X1`, `Y1`, `Z1`, ... Then a line for each frame, cells between
tabs. An empty cell is a missing place.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Sequence

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.measured_positions import MeasuredPositions, sensible_rate
from stages.shared.formats.positions_csv import lines_of, numbers_of, rate_of_times
from stages.shared.formats.recording import MAX_JOINTS

_UNITS_M = {"m": 1.0, "meters": 1.0, "metres": 1.0, "cm": 0.01, "mm": 0.001, "millimeters": 0.001, "in": 0.0254}


def read_trc(data: bytes, name: str) -> MeasuredPositions:
    """The places of a file's markers in its own unit, with names, rate and unit.

    Raises: InputError naming the line.
    """
    lines = lines_of(data)
    heads = [next(lines, (0, "")) for _ in range(4)]
    facts = dict(zip(heads[1][1].split(), heads[2][1].split(), strict=False))
    names = _names(heads[3][1].rstrip("\r\n").split("\t"), f"{name}, line {heads[3][0]}")
    declared = facts.get("NumMarkers", "")
    if declared.isdecimal() and declared != str(len(names)):
        raise InputError(
            f"{name}, line {heads[3][0]}: there are {len(names)} names, and NumMarkers is {declared[:20]}.",
            "Is the file damaged?",
        )
    numbers = array("d")
    width = 2 + 3 * len(names)
    for number, line in lines:
        cells = [cell.strip() for cell in line.rstrip("\r\n").split("\t")]
        if not numbers and _are_axes(cells):
            continue
        numbers.extend(_row(cells, width, f"{name}, line {number}"))
    values = np.frombuffer(numbers, np.float64).reshape(-1, width)
    if not len(values):
        raise InputError(f"{name} has no rows.")
    places = values[:, 2:].reshape(len(values), len(names), 3).copy()
    places[~np.isfinite(places)] = np.nan
    return MeasuredPositions(places, names, fps=_rate(facts, values[:, 1], name), unit_m=_unit(facts, name))


def _names(cells: Sequence[str], where: str) -> tuple[str, ...]:
    if len(cells) < 3 or not cells[0].strip().lower().startswith("frame"):
        raise InputError(f"{where}: expected Frame#, Time and the names of markers, separated by tabs.")
    names = tuple(cell.strip() for cell in cells[2:] if cell.strip())
    if not names or len(names) > MAX_JOINTS:
        raise InputError(f"{where}: there are {len(names)} names of markers; pumps reads 1 to {MAX_JOINTS}.")
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise InputError(f"{where}: the marker '{name[:60]}' stands twice.")
    return names


def _are_axes(cells: Sequence[str]) -> bool:
    """Whether a line is that of X1, Y1, Z1, ..."""
    return next((cell for cell in cells if cell), "")[:1] in ("X", "x")


def _row(cells: list[str], width: int, where: str) -> list[float]:
    if len(cells) > width and not any(cells[width:]):
        cells = cells[:width]  # tabs at the end
    short = width - len(cells)
    if short > 0 and short % 3 == 0:
        cells = cells + [""] * short  # missing places at the end
    if len(cells) != width:
        raise InputError(f"{where}: {len(cells)} cells where {width} are expected.", "Is the file truncated?")
    return numbers_of(cells, where)


def _rate(facts: dict[str, str], times: np.ndarray, name: str) -> float | None:
    try:
        rate = float(facts.get("DataRate", ""))
    except ValueError:
        return rate_of_times(times, name) if len(times) > 1 else None
    return sensible_rate(rate, name)


def _unit(facts: dict[str, str], name: str) -> float | None:
    unit = facts.get("Units", "")
    if unit and unit.lower() not in _UNITS_M:
        raise InputError(f"{name}: Units is '{unit[:20]}', and must be one of {', '.join(_UNITS_M)}.")
    return _UNITS_M.get(unit.lower())
