"""A small chart of several lines, one for each method, as inline SVG with the names in the lines' colours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from stages.report.curves import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Point, even_ticks, log_ticks
from stages.shared.markup import Markup, markup
from stages.shared.statistics.measurements import TRUTH

_NAMED = ("second", "third", "fourth", "fifth")  # colours of page.css
_TURN_DEG = 137.5  # between the hues of two other methods, which are all of one lightness
LOG_SPAN = 6.0  # lines that span more than this factor are drawn on a logarithmic axis


def line_chart(
    caption: str,
    lines: Mapping[str, Sequence[Point]],
    ticks_x: Sequence[float],
    methods: Sequence[str],
    *,
    levels: Sequence[float] = (),
) -> Markup:
    """A figure. The truth's line is thick and has the text's colour.

    Args:
        lines: by method, points (x, y) with x between the first and the last of `ticks_x`. Heights are drawn on a
            logarithmic axis where they are positive and span more than `LOG_SPAN`.
        methods: all methods of the page; a method's place here decides its colour, so that it has one in all charts.
        levels: heights that the axis includes in any case.
    """
    heights = [*levels, *(y for points in lines.values() for _, y in points)]
    low, high = min(heights), max(heights)
    logarithmic = low > 0 and high / low > LOG_SPAN
    ticks = log_ticks(low, high) if logarithmic else even_ticks(low, high)
    first, last = ticks_x[0], ticks_x[-1]

    def place(x: float, y: float) -> tuple[float, float]:
        across = (x - first) / (last - first)
        if logarithmic:
            up = math.log(y / ticks[0]) / math.log(ticks[-1] / ticks[0])
        else:
            up = (y - ticks[0]) / (ticks[-1] - ticks[0])
        return LEFT + (WIDTH - LEFT - RIGHT) * across, HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * up

    parts: list[Markup] = []
    for tick in ticks:
        y = place(first, tick)[1]
        parts += [
            markup('<line class="grid" x1="{}" x2="{}" y1="{:.1f}" y2="{:.1f}"/>', LEFT, WIDTH - RIGHT, y, y),
            markup('<text x="{}" y="{:.1f}" text-anchor="end">{:.4g}</text>', LEFT - 6, y + 4, tick),
        ]
    for x in ticks_x:
        left = place(x, ticks[0])[0]
        parts.append(markup('<text x="{:.1f}" y="{}" text-anchor="middle">{:g}</text>', left, HEIGHT - 10, x))
    names: list[Markup] = []
    for name, points in lines.items():
        true = name == TRUTH
        colour = markup("var(--text)") if true else method_colour(list(methods).index(name))
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(*point) for point in points))
        width = 3.5 if true else 1.75
        parts.append(
            markup('<polyline style="stroke:{};fill:none;stroke-width:{}" points="{}"/>', colour, width, path)
        )
        names.append(markup('<span style="color:{}">{}</span> ', colour, name))
    return markup(
        '<figure><figcaption>{caption}<br><small class="names">{names}</small></figcaption>'
        '<svg viewBox="0 0 {width} {height}" role="img" aria-label="{caption}">{parts}</svg></figure>',
        caption=caption, names=names, width=WIDTH, height=HEIGHT, parts=parts,
    )  # fmt: skip


def method_colour(number: int) -> Markup:
    """The CSS colour of the method with this number, legible on light and on dark pages; as in the player, where the
    truth comes first."""
    if number < len(_NAMED):
        return markup("var(--{})", _NAMED[number])
    return markup("oklch(64% 0.15 {})", round((number + 1) * _TURN_DEG) % 360)
