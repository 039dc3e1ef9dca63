"""Error against lost packets as an SVG: a line for each way of streaming."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stages.shared.markup import Markup, joined, markup

_WIDTH, _HEIGHT, _LEFT, _TOP, _KEY = 420, 280, 60, 40, 250
_COLOURS = ("#1f77b4", "#2ca02c", "#ff7f0e", "#d62728", "#444444", "#999999", "#9467bd", "#17becf")


def loss_picture(lines: Mapping[str, Sequence[float]], losses: Sequence[float], words: Mapping[str, str]) -> Markup:
    """The SVG text. lines: name -> cm at each loss; losses rising, in shares; words: what to add to a name."""
    most = 1.05 * max(max(values) for values in lines.values()) or 1.0
    widest = max(losses) or 1.0
    page = (_LEFT + _WIDTH + _KEY, _TOP + _HEIGHT + 50)

    def x(loss: float) -> float:
        return _LEFT + _WIDTH * loss / widest

    def y(value: float) -> float:
        return _TOP + _HEIGHT * (1 - value / most)

    parts = [
        markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0} {1}" width="{0}" height="{1}" '
            'font-family="sans-serif" font-size="12">', *page,
        ),
        markup('<rect width="100%" height="100%" fill="#ffffff"/>'),
        markup('<text x="{}" y="20">MPJPE, cm at 1.80 m, against the share of packets lost</text>', _LEFT),
    ]  # fmt: skip
    for tick in range(5):
        value = most * tick / 4
        parts.append(markup('<path d="M{} {:.1f}h{}" stroke="#dddddd" fill="none"/>', _LEFT, y(value), _WIDTH))
        parts.append(
            markup('<text x="{}" y="{:.1f}" text-anchor="end">{:.1f}</text>', _LEFT - 6, y(value) + 4, value)
        )
    for loss in losses:
        place = (x(loss), _TOP + _HEIGHT + 18)
        parts.append(markup('<text x="{:.1f}" y="{}" text-anchor="middle">{:.0f} %</text>', *place, 100 * loss))
    for index, (name, values) in enumerate(lines.items()):
        colour = _COLOURS[index % len(_COLOURS)]
        points = " ".join(f"{x(a):.1f},{y(b):.1f}" for a, b in zip(losses, values, strict=True))
        parts.append(markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="2"/>', points, colour))
        at = (_LEFT + _WIDTH + 16, _TOP + 16 + 20 * index)
        parts.append(markup('<text x="{}" y="{}" fill="{}">{}{}</text>', *at, colour, name, words.get(name, "")))
    return joined([*parts, markup("</svg>\n")], "\n")
