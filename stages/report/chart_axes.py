"""The axes of a small chart as inline SVG: ticks, grid lines, and where a point lies."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from stages.shared.markup import Markup, markup

WIDTH, HEIGHT = 400, 210
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 10, 28
LOG_SPAN = 5.0  # heights that span more than this factor are drawn on a logarithmic axis

Point = tuple[float, float]


class Axes:
    """Axes that hold all heights; logarithmic upwards where these are positive and span more than `LOG_SPAN`.

    Args:
        heights: at least one. across: the least and the greatest x.
    """

    def __init__(self, heights: Sequence[float], across: tuple[float, float]):
        low, high = min(heights), max(heights)
        self.first, self.last = across
        self.logarithmic = low > 0 and high / low > LOG_SPAN
        self.ticks = log_ticks(low, high) if self.logarithmic else even_ticks(low, high)

    def place(self, x: float, y: float) -> Point:
        """Where a point lies in the drawing."""
        across = (x - self.first) / (self.last - self.first)
        low, high = self.ticks[0], self.ticks[-1]
        up = math.log(y / low) / math.log(high / low) if self.logarithmic else (y - low) / (high - low or 1.0)
        return LEFT + (WIDTH - LEFT - RIGHT) * across, HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * up

    def path(self, points: Sequence[Point]) -> str:
        """The points of a polyline."""
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in (self.place(*point) for point in points))

    def drawn(self, ticks_x: Sequence[float], words: Callable[[float], str] = "{:g}".format) -> list[Markup]:
        """Grid lines and the words of the ticks."""
        parts: list[Markup] = []
        for tick in self.ticks:
            y = self.place(self.first, tick)[1]
            parts += [
                markup('<line class="grid" x1="{}" x2="{}" y1="{:.1f}" y2="{:.1f}"/>', LEFT, WIDTH - RIGHT, y, y),
                markup('<text x="{}" y="{:.1f}" text-anchor="end">{:.4g}</text>', LEFT - 6, y + 4, tick),
            ]
        for tick in ticks_x:
            x = self.place(tick, self.ticks[0])[0]
            text = '<text x="{:.1f}" y="{}" text-anchor="middle">{}</text>'
            parts.append(markup(text, x, HEIGHT - 10, words(tick)))
        return parts


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
