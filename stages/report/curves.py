"""Loss curves as inline SVG, from a checkpoint's log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from stages.report.chart_axes import HEIGHT, WIDTH, Axes, Point, even_ticks
from stages.shared.markup import Markup, markup

NO_CURVE = ("step", "seconds", "split", "learning_rate", "rate")
SMOOTH_POINTS = 120  # training values are averaged into about so many points


def curves_html(log: Sequence[Mapping[str, Any]]) -> Markup:
    """One small chart for each figure of the log: training thin, validation thick."""
    names = [name for row in log for name, value in row.items() if name not in NO_CURVE and _is_number(value)]
    charts = []
    for name in dict.fromkeys(names):
        series = {split: _points(log, name, split) for split in ("train", "val")}
        if any(len(points) > 1 for points in series.values()):
            charts.append(_chart(name, series))
    if not charts:
        return markup("<p>Its log holds no curves.</p>")
    return markup('<div class="curves">{}</div>', charts)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _points(log: Sequence[Mapping[str, Any]], name: str, split: str) -> list[Point]:
    found = [
        (float(row["step"]), float(row[name]))
        for row in log
        if row.get("split", "train") == split and _is_number(row.get(name)) and _is_number(row.get("step"))
    ]
    return _averaged(found) if split == "train" else found


def _averaged(points: list[Point]) -> list[Point]:
    size = max(1, math.ceil(len(points) / SMOOTH_POINTS))
    groups = [points[i : i + size] for i in range(0, len(points), size)]
    return [(sum(x for x, _ in g) / len(g), sum(y for _, y in g) / len(g)) for g in groups]


def _chart(name: str, series: Mapping[str, list[Point]]) -> Markup:
    everything = [point for points in series.values() for point in points]
    x_last = max(x for x, _ in everything) or 1
    axes = Axes([y for _, y in everything], (0, x_last))
    parts = axes.drawn([tick for tick in even_ticks(0, x_last) if tick <= x_last], "{:,.0f}".format)
    for split, points in series.items():
        if points:
            parts.append(markup('<polyline class="{}" points="{}"/>', split, axes.path(points)))
    last = series["val"][-1] if series["val"] else None
    note = ""
    if last:
        x, y = axes.place(*last)
        parts.append(markup('<circle class="val-dot" cx="{:.1f}" cy="{:.1f}" r="3"/>', x, y))
        note = markup(" <small>validation ends at {:.4g}</small>", last[1])
    return markup(
        '<figure><figcaption>{label}{note}</figcaption><svg viewBox="0 0 {width} {height}" role="img" '
        'aria-label="{label} over steps">{parts}</svg></figure>',
        label=name.replace("_", " "), note=note, width=WIDTH, height=HEIGHT, parts=parts,
    )  # fmt: skip
