"""The tables of the page: Table 1, methods beside the best of the others, error against training time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.stats import wilcoxon

from data_schemas.metrics import MetricRow
from stages.measure.table1 import paper
from stages.measure.table1.joined import Joined
from stages.shared.statistics.bootstrap import ratio_interval
from stages.shared.statistics.measurements import METRICS, POWER_WEIGHTED
from stages.shared.statistics.table import Entry, Row, Table, without_repeats
from stages.shared.statistics.tables import ALL, Cell, Key, cells, counted, in_order, scopes_of, span_text, task_words

NINE = ("l2p_m", "l2q", "npss")


def intervals_of(found: dict[Key, Cell], task: str) -> list[int]:
    """The intervals of a task, rising."""
    return sorted({key[2] for key in found if key[1] == task})


def trained_words(joined: Joined, method: str) -> str:
    """Native, non-native, or untrained."""
    weights = joined.weights.get(method)
    if weights is None:
        return "untrained"
    if weights.native is None:
        return "unknown"
    return "native" if weights.native else "non-native"


def table_1(joined: Joined, found: dict[Key, Cell], scope: str) -> Iterator[str]:
    """Markdown: for each task a table of all methods; the least value of a column is bold."""
    for task in dict.fromkeys(key[1] for key in found if key[0] == scope):
        here = intervals_of(found, task)
        columns = [(metric, interval) for metric in NINE for interval in here]
        grid = {
            method: [found.get((scope, task, interval, metric, method)) for metric, interval in columns]
            for method in joined.methods
        }
        values = {name: [c.mean.value if c else float("nan") for c in row] for name, row in grid.items()}
        yield f"{task_words(task)}:\n"
        yield _nine(values, columns, lambda name: trained_words(joined, name))


def paper_shares(task: str) -> str:
    """Markdown: the printed table's L2P as shares of SLERP's."""
    rows = paper.TABLE_1[task]
    base = rows["SLERP"]
    heads = tuple(f"L2P {i}" for i in paper.INTERVALS[task])
    made = [
        Row((name,), tuple(Entry(f"{a / b:.2f}") for a, b in zip(v[:3], base, strict=False)))
        for name, v in rows.items()
    ]
    return "\n".join(Table(("method",), heads, tuple(made)).markdown()) + "\n"


def beside_best(joined: Joined, found: dict[Key, Cell], ours: Sequence[str], seed: int, scope: str) -> Table:
    """Each of our methods beside the best other one of every column: the ratio of their means over the same clips,
    its 95 % bootstrap interval, and the p of Wilcoxon's signed-rank test on the clips' differences.

    scope: the archive or category whose clips are compared, or all of them together.
    """
    rows = _beside_best_rows(joined, found, ours, seed, scope, NINE)
    return Table(("task", "figure", "best other"), tuple(ours), without_repeats(rows))


def beside_best_by_category(joined: Joined, found: dict[Key, Cell], ours: Sequence[str], seed: int) -> Table | None:
    """The same of L2P in every category, with its number of clips; None if there is one category alone."""
    rows = []
    for scope in scopes_of(found)[:-1]:
        clips = len({row.clip for row in joined.rows if row.archive == scope})
        label = f"{scope} ({counted(clips, 'clip')})"
        made = _beside_best_rows(joined, found, ours, seed, scope, NINE[:1])
        rows += [Row((label, *row.labels), row.entries) for row in made]
    heads = ("data", "task", "figure", "best other")
    return Table(heads, tuple(ours), without_repeats(rows)) if rows else None


def _beside_best_rows(
    joined: Joined, found: dict[Key, Cell], ours: Sequence[str], seed: int, scope: str, metrics: Sequence[str]
) -> list[Row]:
    rows = []
    measured = [row for row in joined.rows if scope in (ALL, row.archive)]
    for task in in_order(found, 1):
        for metric in metrics:
            for interval in intervals_of(found, task):
                others = {
                    name: cell.mean.value
                    for name in joined.methods
                    if name not in ours and (cell := found.get((scope, task, interval, metric, name)))
                }
                if not others:
                    continue
                best = min(others, key=lambda name: others[name])
                entries = [_compared(measured, (task, interval, metric), name, best, seed) for name in ours]
                label = METRICS[metric].label
                rows.append(Row((task_words(task).split(",")[0], f"{label} {interval}", best), tuple(entries)))
    return rows


def _compared(rows: Sequence[MetricRow], column: tuple[str, int, str], name: str, best: str, seed: int) -> Entry:
    pairs: dict[str, dict[tuple[str, str], MetricRow]] = {name: {}, best: {}}
    for row in rows:
        if (row.task, row.interval, row.metric) == column and row.method in pairs:
            pairs[row.method][row.archive, row.clip] = row
    clips = sorted(pairs[name].keys() & pairs[best].keys())
    if not clips:
        return Entry()

    def columns(method: str) -> tuple[np.ndarray, np.ndarray]:
        picked = [pairs[method][clip] for clip in clips]
        power = column[2] in POWER_WEIGHTED
        return (
            np.array([row.value for row in picked]),
            np.array([row.weight if power else row.windows for row in picked], float),
        )

    (ours, weights), (theirs, their_weights) = columns(name), columns(best)
    ratio = ratio_interval(ours, weights, theirs, their_weights, seed)
    differ = len(clips) > 1 and bool((ours != theirs).any())
    chance = float(wilcoxon(ours, theirs)[1]) if differ else 1.0  # pyright: ignore[reportArgumentType]
    return Entry(f"×{ratio.value:.2f}", span_text(ratio, 2), f"p {chance:.2g}")


def curve(joined: Joined, others: Sequence[Joined], found: dict[Key, Cell], seed: int) -> Table:
    """L2P of methods trained for several times, as shares of slerp's, minutes rising."""
    scope = scopes_of(found)[-1]
    columns = [(task, i) for task in in_order(found, 1) for i in intervals_of(found, task)]
    again = {name for other in others for name in other.weights}
    points = []
    for source, source_cells in ((joined, found), *((other, cells(other.rows, seed)) for other in others)):
        for name, weights in source.weights.items():
            if name in again and weights.minutes is not None:
                points.append((name, weights.minutes, source_cells))
    rows = []
    for name, minutes, source_cells in sorted(points, key=lambda point: point[:2]):
        entries = []
        for task, interval in columns:
            mine = source_cells.get((scope, task, interval, "l2p_m", name))
            base = found.get((scope, task, interval, "l2p_m", "slerp"))
            entries.append(Entry(f"{mine.mean.value / base.mean.value:.2f}" if mine and base else ""))
        rows.append(Row((name, f"{minutes:g}"), tuple(entries)))
    heads = tuple(f"{task} {interval}" for task, interval in columns)
    return Table(("method", "minutes of training"), heads, without_repeats(rows))


def costs(joined: Joined) -> Table:
    """Minutes of training, and milliseconds of filling a frame, of each method."""
    rows = []
    for name in joined.methods:
        weights = joined.weights.get(name)
        minutes = "" if weights is None or weights.minutes is None else f"{weights.minutes:g}"
        spent = joined.milliseconds.get(name)
        rows.append(
            Row((name, trained_words(joined, name)), (Entry(minutes), Entry("" if spent is None else f"{spent:.3g}")))
        )
    return Table(("method", "trained"), ("minutes of training", "ms a frame"), tuple(rows))


def _nine(values: dict[str, list[float]], columns: Sequence[tuple[str, int]], words) -> str:
    least = [np.nanmin(column) if np.isfinite(column).any() else np.nan for column in np.array([*values.values()]).T]
    rows = []
    for name, row in values.items():
        shown = (
            "" if np.isnan(v) else f"**{v:.3f}**" if v == best else f"{v:.3f}"
            for v, best in zip(row, least, strict=True)
        )
        rows.append(Row((name, words(name)), tuple(map(Entry, shown))))
    heads = tuple(f"{METRICS[metric].label} {interval}" for metric, interval in columns)
    return "\n".join(Table(("method", "trained"), heads, tuple(rows)).markdown()) + "\n"
