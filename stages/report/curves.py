"""Loss curves as inline SVG, from a checkpoint's log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from stages.shared.markup import Markup, markup

WIDTH, HEIGHT = 400, 210
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 10, 28
NO_CURVE = ("step", "seconds", "split", "learning_rate", "rate")
LOG_SPAN = 4.0  # a figure that falls by more than this factor is drawn on a logarithmic axis
SMOOTH_POINTS = 120  # training values are averaged into about so many points

Point = tuple[float, float]


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
    low, high = min(y for _, y in everything), max(y for _, y in everything)
    logarithmic = low > 0 and high / low > LOG_SPAN
    ticks = log_ticks(low, high) if logarithmic else even_ticks(low, high)
    low, high = min(low, ticks[0]), max(high, ticks[-1])

    def place(x: float, y: float) -> tuple[float, float]:
        share = math.log(y / low) / math.log(high / low) if logarithmic else (y - low) / ((high - low) or 1)
        return LEFT + (WIDTH - LEFT - RIGHT) * x / x_last, HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * share

    parts = []
    for tick in ticks:
        y = place(0, tick)[1]
        parts += [
            markup('<line class="grid" x1="{}" x2="{}" y1="{:.1f}" y2="{:.1f}"/>', LEFT, WIDTH - RIGHT, y, y),
            markup('<text x="{}" y="{:.1f}" text-anchor="end">{:.4g}</text>', LEFT - 6, y + 4, tick),
        ]
    for tick in even_ticks(0, x_last, 4):
        if tick <= x_last:
            x = place(tick, low)[0]
            parts.append(markup('<text x="{:.1f}" y="{}" text-anchor="middle">{:,.0f}</text>', x, HEIGHT - 10, tick))
    for split, points in series.items():
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(*point) for point in points))
        if points:
            parts.append(markup('<polyline class="{}" points="{}"/>', split, path))
    last = series["val"][-1] if series["val"] else None
    note = ""
    if last:
        x, y = place(*last)
        parts.append(markup('<circle class="val-dot" cx="{:.1f}" cy="{:.1f}" r="3"/>', x, y))
        note = markup(" <small>validation ends at {:.4g}</small>", last[1])
    return markup(
        '<figure><figcaption>{label}{note}</figcaption><svg viewBox="0 0 {width} {height}" role="img" '
        'aria-label="{label} over steps">{parts}</svg></figure>',
        label=name.replace("_", " "), note=note, width=WIDTH, height=HEIGHT, parts=parts,
    )  # fmt: skip


def even_ticks(low: float, high: float, count: int = 4) -> list[float]:
    """About `count` round numbers with even steps, from `low` or less to `high` or more."""
    span = (high - low) or abs(high) or 1.0
    raw = span / count
    size = 10 ** math.floor(math.log10(raw))
    step = next(size * factor for factor in (1, 2, 2.5, 5, 10) if size * factor >= raw * 0.999)
    first = math.floor(low / step)
    return [i * step for i in range(first, math.ceil(high / step) + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers with even steps of their logarithm, from `low` or less to `high` or more."""
    fine = (1, 2, 5) if high / low < 100 else (1,)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [factor * 10.0**decade for decade in decades for factor in fine]
    first = max([i for i, tick in enumerate(ticks) if tick <= low], default=0)
    last = min([i for i, tick in enumerate(ticks) if tick >= high], default=len(ticks) - 1)
    return ticks[first : last + 1]
