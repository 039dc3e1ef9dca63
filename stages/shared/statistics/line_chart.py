"""Lines over an axis as an SVG that stands alone: error against lost packets, or against minutes of training."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from stages.shared.markup import Markup, joined, markup

_WIDTH, _HEIGHT, _LEFT, _TOP, _KEY = 420, 280, 60, 40, 310
_COLOURS = ("#1f77b4", "#2ca02c", "#ff7f0e", "#d62728", "#444444", "#999999", "#9467bd", "#17becf")
_DOT = 3


def line_chart(
    title: str,
    lines: Mapping[str, Sequence[tuple[float, float]]],
    ticks: Mapping[float, str],
    *,
    shown: Callable[[float], float] = float,
    dots: bool = False,
) -> Markup:
    """The SVG text.

    Args:
        lines: name -> points (x, y), x rising; y from zero up.
        ticks: the x that are marked, with their words; the axis reaches from the least to the greatest.
        shown: where an x lies on the axis, such as `math.log` for a logarithmic one.
        dots:  whether each point has a dot.
    """
    most = 1.05 * max(y for points in lines.values() for _, y in points) or 1.0
    first, last = shown(min(ticks)), shown(max(ticks))
    page = (_LEFT + _WIDTH + _KEY, _TOP + _HEIGHT + 50)

    def place(x: float, y: float) -> tuple[float, float]:
        across = (shown(x) - first) / ((last - first) or 1.0)
        return _LEFT + _WIDTH * across, _TOP + _HEIGHT * (1 - y / most)

    parts = [
        markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0} {1}" width="{0}" height="{1}" '
            'font-family="sans-serif" font-size="12">', *page,
        ),
        markup('<rect width="100%" height="100%" fill="#ffffff"/>'),
        markup('<text x="{}" y="20">{}</text>', _LEFT, title),
    ]  # fmt: skip
    for tick in range(5):
        value = most * tick / 4
        y = place(min(ticks), value)[1]
        parts.append(markup('<path d="M{} {:.1f}h{}" stroke="#dddddd" fill="none"/>', _LEFT, y, _WIDTH))
        parts.append(markup('<text x="{}" y="{:.1f}" text-anchor="end">{:.1f}</text>', _LEFT - 6, y + 4, value))
    for x, words in ticks.items():
        at = (place(x, 0)[0], _TOP + _HEIGHT + 18)
        parts.append(markup('<text x="{:.1f}" y="{}" text-anchor="middle">{}</text>', *at, words))
    for index, (name, points) in enumerate(lines.items()):
        colour = _COLOURS[index % len(_COLOURS)]
        places = [place(*point) for point in points]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        parts.append(markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="2"/>', path, colour))
        if dots:
            circle = '<circle cx="{:.1f}" cy="{:.1f}" r="{}" fill="{}"/>'
            parts += [markup(circle, x, y, _DOT, colour) for x, y in places]
        at = (_LEFT + _WIDTH + 16, _TOP + 16 + 20 * index)
        parts.append(markup('<text x="{}" y="{}" fill="{}">{}</text>', *at, colour, name))
    return joined([*parts, markup("</svg>\n")], "\n")
