"""The table of feel: for every task a row for the truth and each method, a column for each figure, with intervals."""

from __future__ import annotations

import numpy as np

from stages.shared.statistics.bootstrap import Estimate
from stages.shared.statistics.measurements import METRICS, TRUTH, metric_named
from stages.shared.statistics.table import Entry, Row, Table
from stages.shared.statistics.tables import Cell, Key, aligned, decimals_of, in_order, scopes_of, span_text

TITLE = "Feel"
COLUMNS = {
    "key_jump_mps": "velocity jump at keys (m/s)",
    "seam_share": "at seams / elsewhere",
    "foot_skate_mps": "foot skate (m/s)",
    "floor_penetration_mm": "below the floor (mm)",
    "jerk_mps3": "jerk, share of the truth's",
    "fell_back_share": "fell back",
}
ASIDE = ("lerp", "cubic")  # plain ways that filling does not start from: in the whole page alone
_MM_DIGITS = 2  # less than a hundredth of a millimetre is rounding
LEGEND = (
    "Feel: mean [95% bootstrap interval over clips]. Jump and skate are best where they are the truth's own, jerk "
    "where it is 1. At seams, where models' windows meet, velocity should change no more than it does in the rows "
    "of the truth and of plain interpolation. Nothing should be below the floor; fell back is the share of filled "
    "frames and bones that a model left at the plain interpolation."
)


def feel_table(found: dict[Key, Cell], scope: str, *, aside: tuple[str, ...] = ()) -> Table | None:
    """One scope's table; None where no feel was measured. Methods of `aside` are left out."""
    rows = _rows(found, scope, aside)
    return Table(("task", "method"), tuple(COLUMNS.values()), tuple(rows)) if rows else None


def feel_markdown(found: dict[Key, Cell], scope: str, *, aside: tuple[str, ...] = ()) -> str:
    """Markdown of one scope's table under a heading of the third level; nothing where no feel was measured."""
    table = feel_table(found, scope, aside=aside)
    return "\n".join([f"### {TITLE}\n", *table.markdown(), ""]) if table else ""


def feel_lines(found: dict[Key, Cell]) -> list[str]:
    """The table of all data together, as aligned text; nothing where no feel was measured."""
    scopes = scopes_of(found)
    rows = _rows(found, scopes[-1], ASIDE) if scopes else []
    if not rows:
        return []
    grid = [[f"{TITLE}:", "", *COLUMNS.values()], *(row.texts() for row in rows)]
    return [*aligned(grid), f"({scopes[-1]}; 95% intervals over clips)"]


def _rows(found: dict[Key, Cell], scope: str, aside: tuple[str, ...]) -> list[Row]:
    rows: list[Row] = []
    measured = {key: cell for key, cell in found.items() if key[0] == scope and metric_named(key[3]).feel}
    for task in in_order(measured, 1):
        for interval in sorted({key[2] for key in measured if key[1] == task}):
            here = {(key[4], key[3]): cell for key, cell in measured.items() if key[1:3] == (task, interval)}
            for number, method in enumerate(m for m in dict.fromkeys(m for m, _ in here) if m not in aside):
                label = f"{task} {interval}" if number == 0 else ""
                entries = tuple(_entry(name, method, here.get((method, name))) for name in COLUMNS)
                rows.append(Row((label, method), entries))
    return rows


def _entry(metric: str, method: str, cell: Cell | None) -> Entry:
    if cell is None:
        return Entry()
    shown = cell.mean
    if METRICS[metric].beside_truth:
        shown = Estimate(1.0, None, None) if method == TRUTH else cell.ratio
    if shown is None or not np.isfinite(shown.value):
        return Entry()
    share = METRICS[metric].beside_truth or METRICS[metric].unit == ""
    digits = 2 if share else decimals_of(shown.value)
    if METRICS[metric].unit == "mm":
        digits = min(digits, _MM_DIGITS)
    return Entry(f"{shown.value:.{digits}f}", span_text(shown, digits))
