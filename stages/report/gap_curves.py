"""Error against the length of the gap: for each task a small chart of L2P as a share of the plain baseline's."""

from __future__ import annotations

from collections.abc import Mapping

from stages.report.chart_axes import Point
from stages.report.line_charts import line_chart
from stages.shared.markup import Markup, markup
from stages.shared.statistics.measurements import METRICS, TRUTH
from stages.shared.statistics.tables import Cell, Key, baseline_of, in_order, scopes_of, task_words


def gap_charts_html(found: Mapping[Key, Cell]) -> Markup | str:
    """The charts of all data together; "" where no method was measured at two intervals."""
    if not found:
        return ""
    scope = scopes_of(dict(found))[-1]
    metric = next((name for name in METRICS if any(key[3] == name for key in found)), "")
    charts = [_chart(found, scope, task, metric) for task in in_order(dict(found), 1)]
    charts = [chart for chart in charts if chart]
    return markup('<div class="curves">{}</div>', charts) if charts else ""


def _chart(found: Mapping[Key, Cell], scope: str, task: str, metric: str) -> Markup | str:
    lines: dict[str, list[Point]] = {}
    for (where, what, interval, name, method), cell in sorted(found.items()):
        if (where, what, name) == (scope, task, metric) and cell.ratio is not None:
            lines.setdefault(method, []).append((interval, cell.ratio.value))
    lines = {method: points for method, points in lines.items() if len(points) > 1}
    if not lines:
        return ""
    across = sorted({float(x) for points in lines.values() for x, _ in points})
    caption = f"{task_words(task)}: {METRICS[metric].label} as a share of {baseline_of(task)}'s"
    methods = [name for name in in_order(dict(found), 4) if name != TRUTH]
    return line_chart(caption, lines, across, methods, levels=(0.9, 1.0))
