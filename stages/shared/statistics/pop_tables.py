"""The table of pops: for every task and method the share of windows that twist or jolt, and the worst windows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from data_schemas.metrics import MetricRow
from stages.shared.statistics.feel_pops import JOLT_SHARE, TWIST_DEG, TWIST_SHARE
from stages.shared.statistics.feel_tables import ASIDE
from stages.shared.statistics.measurements import first_frame_of
from stages.shared.statistics.table import Entry, Row, Table
from stages.shared.statistics.tables import ALL, aligned

TITLE = "Pops"
SHARES = {"twist_share": "windows that twist", "jolt_share": "windows that jolt"}
WORST = {
    "largest_turn_deg": "largest turn (degrees a frame)",
    "largest_acceleration_mps2": "largest acceleration (m/s²)",
    "crossing_frames": "shins crossed (frames)",
    "floating_mm": "feet above the floor (mm)",
}
LEGEND = (
    f"Pops: the share of windows that twist (a joint turns more than {TWIST_DEG:g} degrees in a frame and "
    f"{TWIST_SHARE:g} times as far as any does in the true window) or jolt (a joint accelerates more than "
    f"{JOLT_SHARE:g} times as much as any does in the true window); then, for each figure, its largest value in any "
    "window, with the clip and the window's first frame at 30 frames a second. The truth's row has the true motion's "
    "own figures."
)


def pop_table(rows: Iterable[MetricRow], scope: str, *, aside: tuple[str, ...] = ()) -> Table | None:
    """One scope's table; None where no pops were measured. Methods of `aside` are left out."""
    cells: dict[tuple[str, int, str], list[MetricRow]] = {}
    for row in rows:
        if scope in (row.archive, ALL) and row.metric in _SHOWN:
            cells.setdefault((row.task, row.interval, row.method), []).append(row)
    made = []
    last = ""
    for task, interval, method in cells:
        if method in aside:
            continue
        label = f"{task} {interval}"
        entries = _entries(cells[task, interval, method])
        made.append(Row(("" if label == last else label, method), entries))
        last = label
    return Table(("task", "method"), (*SHARES.values(), *WORST.values()), tuple(made)) if made else None


def pop_markdown(rows: Iterable[MetricRow], scope: str) -> str:
    """Markdown of one scope's table under a heading of the third level; nothing where no pops were measured."""
    table = pop_table(rows, scope)
    return "\n".join([f"### {TITLE}\n", *table.markdown(), ""]) if table else ""


def pop_lines(rows: Sequence[MetricRow]) -> list[str]:
    """The table of all data together, as aligned text; nothing where no pops were measured."""
    table = pop_table(rows, ALL, aside=ASIDE)
    if table is None:
        return []
    return aligned([[f"{TITLE}:", "", *table.columns], *(row.texts() for row in table.rows)])


_SHOWN = {*SHARES, *WORST, *(first_frame_of(metric) for metric in WORST)}


def _entries(rows: list[MetricRow]) -> tuple[Entry, ...]:
    """A share for each of `SHARES`, a window's value, clip and first frame for each of `WORST`."""
    found = {(row.metric, row.archive, row.clip): row for row in rows}
    entries = []
    for metric in SHARES:
        some = [row for row in rows if row.metric == metric]
        counts = np.array([row.windows for row in some], float)
        share = float((counts * [row.value for row in some]).sum() / counts.sum()) if some else np.nan
        entries.append(Entry(f"{share:.1%}") if np.isfinite(share) else Entry())
    for metric in WORST:
        some = [row for row in rows if row.metric == metric]
        if not some:
            entries.append(Entry())
            continue
        worst = max(some, key=lambda row: row.value)
        at = found[first_frame_of(metric), worst.archive, worst.clip]
        digits = 0 if metric == "crossing_frames" else 1
        entries.append(Entry(f"{worst.value:.{digits}f}", f"{worst.clip} {at.value:.0f}"))
    return tuple(entries)
