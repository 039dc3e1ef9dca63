"""From rows to tables: averages over clips, intervals, ratios to the plain baseline; Markdown and aligned text."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_schemas.metrics import MetricRow
from stages.shared.statistics.bootstrap import Estimate, mean_interval, ratio_interval
from stages.shared.statistics.measurements import METRICS, POWER_WEIGHTED, TRUTH, metric_named
from stages.shared.statistics.table import Entry, Row, Table
from stages.shared.statistics.tasks import INTERPOLATION, PREDICTION, RECONSTRUCTION, RETARGETING, TRANSITION

ALL = "all archives"
TASK_WORDS = {
    INTERPOLATION: "Interpolation, frames between keys",
    TRANSITION: "Transition, missing frames",
    PREDICTION: "Prediction, last frames",
    RETARGETING: "Retargeting, spread of the clouds in mm",
    RECONSTRUCTION: "Reconstruction, known frames",
}
DIGITS = 3
LEGEND = (
    "In the tables below: mean [95% bootstrap interval over clips] ×ratio to slerp (in prediction to zero velocity) "
    "on the same windows, with a star where the ratio's own 95% interval leaves out 1. Lower is better. In the "
    "header: the windows and clips measured."
)


@dataclass(frozen=True)
class Cell:
    """One figure of a table: the average over clips, and its ratio to the baseline's or truth's on the same clips."""

    mean: Estimate
    ratio: Estimate | None
    clips: int
    windows: int


Key = tuple[str, str, int, str, str]  # scope, task, interval, metric, method


def baseline_of(task: str) -> str:
    """The method that ratios are taken to."""
    return "zero-velocity" if task == PREDICTION else "slerp"


def cells(rows: Iterable[MetricRow], seed: int = 0) -> dict[Key, Cell]:
    """All averages of the rows: for each archive, and for all together.

    A clip is weighted by its number of windows; for NPSS, by the power of its windows.
    """
    grouped: dict[Key, dict[tuple[str, str], MetricRow]] = defaultdict(dict)
    for row in rows:
        for scope in (row.archive, ALL):
            grouped[scope, row.task, row.interval, row.metric, row.method][row.archive, row.clip] = row
    return {key: _cell(key, group, grouped, seed) for key, group in grouped.items()}


def _cell(key: Key, group: dict, grouped: dict[Key, dict], seed: int) -> Cell:
    scope, task, interval, metric, method = key
    beside = TRUTH if metric_named(metric).beside_truth else baseline_of(task)
    base = grouped.get((scope, task, interval, metric, beside), {})
    clips = sorted(group)
    values, weights = _columns(group, clips, metric)
    ratio = None
    compared = metric_named(metric).beside_truth or not metric_named(metric).feel
    if compared and method not in (beside, TRUTH) and base.keys() == group.keys():
        ratio = ratio_interval(values, weights, *_columns(base, clips, metric), seed)
    windows = sum(group[clip].windows for clip in clips)
    return Cell(mean_interval(values, weights, seed), ratio, len(clips), windows)


def _columns(group: dict, clips: Sequence, metric: str) -> tuple[np.ndarray, np.ndarray]:
    rows = [group[clip] for clip in clips]
    weights = [row.weight if metric in POWER_WEIGHTED else row.weight * row.windows for row in rows]
    return np.array([row.value for row in rows]), np.array(weights)


def in_order(found: dict[Key, Cell], position: int) -> list:
    """The distinct values of one part of the keys, in the order of the rows."""
    return list(dict.fromkeys(key[position] for key in found))


def scopes_of(found: dict[Key, Cell]) -> list[str]:
    """Archives in order, and all together last if there are several."""
    archives = [scope for scope in in_order(found, 0) if scope != ALL]
    return [*archives, ALL] if len(archives) > 1 else archives


@dataclass(frozen=True)
class TaskTables:
    """The tables of one task: its heading, the headline metrics with intervals, then the others."""

    title: str
    tables: tuple[Table, ...]


def tables_of_scope(found: dict[Key, Cell], scope: str) -> list[TaskTables]:
    """For every task of a scope: the headline metrics with intervals, then the others."""
    tasks = {task: _of_task(found, scope, task) for task in in_order(found, 1)}
    return [TaskTables(task_words(task), _tables_of_task(here)) for task, here in tasks.items() if here]


def task_tables(found: dict[Key, Cell], more: Callable[[str], str] = lambda scope: "") -> str:
    """Markdown: the tables of every scope, each followed by `more` of the scope."""
    parts: list[str] = []
    for scope in scopes_of(found):
        parts.append(f"## {scope}\n")
        for section in tables_of_scope(found, scope):
            parts.append(f"### {section.title}\n")
            for table in section.tables:
                parts += [*table.markdown(), ""]
        parts += [text for text in [more(scope)] if text]
    return "\n".join(parts)


def task_words(task: str) -> str:
    """The heading of a task."""
    return TASK_WORDS.get(task, task)


def _of_task(found: dict[Key, Cell], scope: str, task: str) -> dict[Key, Cell]:
    return {key: cell for key, cell in found.items() if key[:2] == (scope, task) and not metric_named(key[3]).feel}


def _tables_of_task(here: dict[Key, Cell]) -> tuple[Table, ...]:
    intervals = sorted({key[2] for key in here})
    tables = []
    for headline in (True, False):
        metrics = [metric for metric in _metrics_of(here) if metric_named(metric).headline == headline]
        if metrics:
            columns = [f"{i} ({_count(here, i)})" if headline else str(i) for i in intervals]
            rows = [row for metric in metrics for row in _metric_rows(metric, intervals, here, headline)]
            tables.append(Table(("metric", "method"), tuple(columns), tuple(rows)))
    return tuple(tables)


def _metrics_of(found: dict[Key, Cell]) -> list[str]:
    """The metrics in the order of `METRICS`, then those that it does not list."""
    here = in_order(found, 3)
    return [*(metric for metric in METRICS if metric in here), *(metric for metric in here if metric not in METRICS)]


def _metric_rows(metric: str, intervals: list[int], here: dict[Key, Cell], headline: bool) -> list[Row]:
    scope, task = next(iter(here))[:2]
    methods = [m for m in in_order(here, 4) if any(key[3] == metric and key[4] == m for key in here)]
    shown = metric_named(metric)
    unit = f" ({shown.unit})" if shown.unit else ""
    rows = []
    for number, method in enumerate(methods):
        label = f"{shown.label}{unit}" if number == 0 else ""
        entries = [_entry(here.get((scope, task, i, metric, method)), intervals=headline) for i in intervals]
        rows.append(Row((label, method), tuple(entries)))
    return rows


def _count(here: dict[Key, Cell], interval: int) -> str:
    cell = next(cell for key, cell in here.items() if key[2] == interval)
    return f"{counted(cell.windows, 'window')} of {counted(cell.clips, 'clip')}"


def counted(count: int, word: str) -> str:
    """`1 clip`, `2 clips`."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def overview_tables(found: dict[Key, Cell]) -> list[tuple[str, Table]]:
    """Each method's first headline metric as a share of the baseline's, for every scope and task: a table with its
    caption for each baseline."""
    metric = next((m for m in METRICS if any(key[3] == m for key in found)), "l2p_m")
    tables = []
    for baseline in dict.fromkeys(map(baseline_of, in_order(found, 1))):
        tasks = [task for task in in_order(found, 1) if baseline_of(task) == baseline]
        columns = [(task, i) for task in tasks for i in sorted({key[2] for key in found if key[1] == task})]
        rows = [row for scope in scopes_of(found) for row in _overview_rows(found, scope, metric, columns)]
        heads = tuple(f"{task} {interval}" for task, interval in columns)
        caption = f"{METRICS[metric].label} as a share of that of {baseline} [95% interval]"
        tables.append((caption, Table(("data", "method"), heads, tuple(rows))))
    return tables


def overview(found: dict[Key, Cell]) -> str:
    """Markdown of `overview_tables`."""
    parts: list[str] = []
    for caption, table in overview_tables(found):
        parts += [f"{caption}:\n", *table.markdown(), ""]
    return "\n".join(parts)


def _overview_rows(found: dict[Key, Cell], scope: str, metric: str, columns: list[tuple[str, int]]) -> list[Row]:
    rows: list[Row] = []
    for method in in_order(found, 4):
        picked = [found.get((scope, task, interval, metric, method)) for task, interval in columns]
        if any(cell and cell.ratio for cell in picked):
            rows.append(Row(("" if rows else scope, method), tuple(map(_ratio_entry, picked))))
    return rows


def _ratio_entry(cell: Cell | None) -> Entry:
    if cell is None or cell.ratio is None or not np.isfinite(cell.ratio.value):
        return Entry()
    return Entry(f"{cell.ratio.value:.2f}", span_text(cell.ratio, 2))


def _entry(cell: Cell | None, *, intervals: bool = True) -> Entry:
    """Mean, interval, ratio to the baseline; a star if the ratio's interval does not contain 1."""
    if cell is None:
        return Entry()
    digits = decimals_of(cell.mean.value)
    entry = Entry(f"{cell.mean.value:.{digits}f}", span_text(cell.mean, digits) if intervals else "")
    if cell.ratio is None or not np.isfinite(cell.ratio.value):
        return entry
    certain = leaves_out_one(cell.ratio)
    verdict = "same" if not certain else "better" if cell.ratio.value < 1 else "worse"
    return replace(entry, ratio=f"×{cell.ratio.value:.2f}{'*' if certain else ''}", verdict=verdict)


def cell_text(cell: Cell | None, *, intervals: bool = True) -> str:
    """`0.412 [0.38, 0.45] ×0.81*`: mean, interval, ratio to the baseline; a star if its interval does not contain
    1."""
    return _entry(cell, intervals=intervals).text


def leaves_out_one(ratio: Estimate) -> bool:
    """Whether a ratio's interval is on one side of 1."""
    return ratio.low is not None and ratio.high is not None and not ratio.low <= 1 <= ratio.high


def span_text(estimate: Estimate, digits: int) -> str:
    """`[0.38, 0.45]`, the interval; "" without one."""
    if estimate.low is None or estimate.high is None:
        return ""
    return f"[{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"


def decimals_of(value: float) -> int:
    """Number of decimals for three significant digits."""
    if not np.isfinite(value) or value == 0:
        return DIGITS
    return int(np.clip(DIGITS - 1 - np.floor(np.log10(abs(value))), 0, 6))


def terminal_lines(found: dict[Key, Cell]) -> list[str]:
    """The headline table of all data together, as aligned text."""
    scope = scopes_of(found)[-1]
    lines: list[str] = []
    for task in in_order(found, 1):
        here = _of_task(found, scope, task)
        if not here:
            continue
        intervals = sorted({key[2] for key in here})
        grid = [[f"{task_words(task)}:", "", *map(str, intervals)]]
        for metric in (m for m in _metrics_of(here) if metric_named(m).headline):
            grid += [row.texts() for row in _metric_rows(metric, intervals, here, True)]
        lines += aligned(grid)
        lines.append(f"({scope}: {_measured_on(here, task, intervals)})")
    return lines


def _measured_on(here: dict[Key, Cell], task: str, intervals: Sequence[int]) -> str:
    """The number of windows and the baseline of ratios; tasks without a baseline measure the same windows in every
    column."""
    if not any(key[4] == baseline_of(task) for key in here):
        return _count(here, intervals[0])
    return f"{', '.join(f'{_count(here, i)} at {i}' for i in intervals)}; ×: share of {baseline_of(task)}'s"


def aligned(grid: list[list[str]]) -> list[str]:
    """A table as lines of text; the first row is its head, whose first cell spans two columns."""
    widths = [max(len(row[column]) for row in grid[column < 2 :]) for column in range(len(grid[0]))]
    title_width = sum(widths[:2]) + 2
    rows = [([f"{grid[0][0]:<{title_width}}", *grid[0][2:]], [title_width, *widths[2:]])]
    rows += [(row, widths) for row in grid[1:]]
    texts = ["  ".join(f"{text:<{width}}" for text, width in zip(*row, strict=True)) for row in rows]
    return [text.rstrip() for text in texts]
