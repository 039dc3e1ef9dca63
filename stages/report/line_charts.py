"""A small chart of several lines, one for each method, as inline SVG with the names in the lines' colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stages.report.chart_axes import HEIGHT, WIDTH, Axes, Point
from stages.shared.markup import Markup, markup
from stages.shared.statistics.measurements import TRUTH

_NAMED = ("second", "third", "fourth", "fifth")  # colours of page.css
_TURN_DEG = 137.5  # between the hues of two other methods, which are all of one lightness


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
        lines: by method, points (x, y) with x between the first and the last of `ticks_x`.
        methods: all methods of the page; a method's place here decides its colour, so that it has one in all charts.
        levels: heights that the axis includes in any case.
    """
    heights = [*levels, *(y for points in lines.values() for _, y in points)]
    axes = Axes(heights, (ticks_x[0], ticks_x[-1]))
    parts = axes.drawn(ticks_x)
    names: list[Markup] = []
    for name, points in lines.items():
        true = name == TRUTH
        colour = markup("var(--text)") if true else method_colour(list(methods).index(name))
        width = 3.5 if true else 1.75
        line = '<polyline style="stroke:{};fill:none;stroke-width:{}" points="{}"/>'
        parts.append(markup(line, colour, width, axes.path(points)))
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
