"""Error against lost packets as an SVG: a line for each way of streaming."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stages.shared.markup import Markup
from stages.shared.statistics.line_chart import line_chart


def loss_picture(lines: Mapping[str, Sequence[float]], losses: Sequence[float], words: Mapping[str, str]) -> Markup:
    """The SVG text. lines: name -> cm at each loss; losses rising, in shares; words: what to add to a name."""
    ticks = {0.0: "0 %"} | {loss: f"{100 * loss:.0f} %" for loss in losses}
    points = {
        f"{name}{words.get(name, '')}": list(zip(losses, values, strict=True)) for name, values in lines.items()
    }
    return line_chart("MPJPE, cm at 1.80 m, against the share of packets lost", points, ticks)
