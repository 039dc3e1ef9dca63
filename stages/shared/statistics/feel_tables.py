"""The table of feel: for every task a row for the truth and each method, a column for each figure, with intervals."""

from __future__ import annotations

import numpy as np

from stages.shared.statistics.bootstrap import Estimate
from stages.shared.statistics.figures import METRICS, TRUTH
from stages.shared.statistics.tables import Cell, Key, aligned, decimals_of, in_order, scopes_of, span_text

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


def feel_markdown(found: dict[Key, Cell], scope: str, *, aside: tuple[str, ...] = ()) -> str:
    """Markdown of one scope's table under a heading of the third level; nothing where no feel was measured."""
    rows = _rows(found, scope, aside)
    if not rows:
        return ""
    head = [f"| task | method | {' | '.join(COLUMNS.values())} |", f"|---|---|{'---:|' * len(COLUMNS)}"]
    return "\n".join(["### Feel\n", *head, *(f"| {' | '.join(row)} |" for row in rows), ""])


def feel_lines(found: dict[Key, Cell]) -> list[str]:
    """The table of all data together, as aligned text; nothing where no feel was measured."""
    scopes = scopes_of(found)
    rows = _rows(found, scopes[-1], ASIDE) if scopes else []
    if not rows:
        return []
    return [*aligned([["Feel:", "", *COLUMNS.values()], *rows]), f"({scopes[-1]}; 95% intervals over clips)"]


def _rows(found: dict[Key, Cell], scope: str, aside: tuple[str, ...]) -> list[list[str]]:
    rows: list[list[str]] = []
    measured = {key: cell for key, cell in found.items() if key[0] == scope and METRICS[key[3]].feel}
    for task in in_order(measured, 1):
        for interval in sorted({key[2] for key in measured if key[1] == task}):
            here = {(key[4], key[3]): cell for key, cell in measured.items() if key[1:3] == (task, interval)}
            for number, method in enumerate(m for m in dict.fromkeys(m for m, _ in here) if m not in aside):
                label = f"{task} {interval}" if number == 0 else ""
                rows.append([label, method, *(_text(name, method, here.get((method, name))) for name in COLUMNS)])
    return rows


def _text(metric: str, method: str, cell: Cell | None) -> str:
    if cell is None:
        return ""
    shown = cell.mean
    if METRICS[metric].beside_truth:
        shown = Estimate(1.0, None, None) if method == TRUTH else cell.ratio
    if shown is None or not np.isfinite(shown.value):
        return ""
    share = METRICS[metric].beside_truth or METRICS[metric].unit == ""
    digits = 2 if share else decimals_of(shown.value)
    if METRICS[metric].unit == "mm":
        digits = min(digits, _MM_DIGITS)
    return f"{shown.value:.{digits}f}{span_text(shown, digits)}"
