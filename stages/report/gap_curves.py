"""Error against the length of the gap: for each task a small chart of L2P as a share of the plain baseline's."""

from __future__ import annotations

from collections.abc import Mapping

from stages.report.curves import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, even_ticks
from stages.shared.markup import Markup, markup
from stages.shared.statistics.measurements import METRICS
from stages.shared.statistics.tables import Cell, Key, baseline_of, in_order, scopes_of, task_words

_TURN_DEG = 137.5  # between the hues of two methods


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
    lines: dict[str, list[tuple[int, float]]] = {}
    for (where, what, interval, name, method), cell in sorted(found.items()):
        if (where, what, name) == (scope, task, metric) and cell.ratio is not None:
            lines.setdefault(method, []).append((interval, cell.ratio.value))
    lines = {method: points for method, points in lines.items() if len(points) > 1}
    if not lines:
        return ""
    everything = [point for points in lines.values() for point in points]
    ticks = even_ticks(min(0.9, *(y for _, y in everything)), max(1.0, *(y for _, y in everything)))
    first, last = min(x for x, _ in everything), max(x for x, _ in everything)

    def place(x: float, y: float) -> tuple[float, float]:
        across, up = (x - first) / (last - first), (y - ticks[0]) / (ticks[-1] - ticks[0])
        return LEFT + (WIDTH - LEFT - RIGHT) * across, HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * up

    parts: list[Markup] = []
    for tick in ticks:
        y = place(first, tick)[1]
        parts.append(
            markup('<line class="grid" x1="{}" x2="{}" y1="{:.1f}" y2="{:.1f}"/>', LEFT, WIDTH - RIGHT, y, y)
        )
        parts.append(markup('<text x="{}" y="{:.1f}" text-anchor="end">{:.4g}</text>', LEFT - 6, y + 4, tick))
    for x in sorted({x for x, _ in everything}):
        left = place(x, ticks[0])[0]
        parts.append(markup('<text x="{:.1f}" y="{}" text-anchor="middle">{}</text>', left, HEIGHT - 10, x))
    names: list[Markup] = []
    for number, (method, points) in enumerate(lines.items()):
        colour = markup("hsl({:.0f} 60% 45%)", number * _TURN_DEG % 360)
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(*point) for point in points))
        parts.append(markup('<polyline style="stroke:{};fill:none;stroke-width:2" points="{}"/>', colour, path))
        names.append(markup('<span style="color:{}">{}</span> ', colour, method))
    caption = f"{task_words(task)}: {METRICS[metric].label} as a share of {baseline_of(task)}'s"
    return markup(
        '<figure><figcaption>{caption}<br><small>{names}</small></figcaption><svg viewBox="0 0 {width} {height}" '
        'role="img" aria-label="{caption}">{parts}</svg></figure>',
        caption=caption, names=names, width=WIDTH, height=HEIGHT, parts=parts,
    )  # fmt: skip
