"""Film strips of filled windows in the page: for each task the window in which the truth travels furthest."""

from __future__ import annotations

from collections.abc import Sequence

from stages.report.strips import PAGE, farthest, strips_svg
from stages.shared.markup import Markup, markup

LEGEND = (
    "Of each task, at its longest gap, the window in which the truth travels furthest, of those that the player has. "
    "A strip for each method, over the truth. The number is the mean distance of the drawn points in this gap."
)


def film_strips_html(scenes: Sequence[dict]) -> Markup:
    """A picture for each task of the scenes of `FilledWindows.scenes`, folded except for the first."""
    parts: list[Markup] = []
    for task in dict.fromkeys(scene["task"] for scene in scenes):
        longest = max(scene["interval"] for scene in scenes if scene["task"] == task)
        shown = farthest([scene for scene in scenes if (scene["task"], scene["interval"]) == (task, longest)])
        picture = strips_svg([shown | {"detail": ""}], PAGE)  # the summary names the clip
        parts.append(
            markup(
                '<details{}><summary>{}</summary><div class="scroll strips">{}</div></details>',
                markup("") if parts else markup(" open"), shown["name"], picture,
            )
        )  # fmt: skip
    return markup('<section id="strips"><h2>Film strips</h2><p>{}</p>{}</section>', LEGEND, parts)
