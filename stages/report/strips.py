"""The player's scenes as one picture: poses over a gap, each motion on the first one, the truth. SVG by hand.

Shown is, of each scene, the gap between two keys in which the truth's points travel furthest: chosen by the truth
alone, so that no method is favoured. All poses are seen from the side that shows most of the body, and each is placed
by its own frame's true pelvis, so that a method's drift shows as such.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stages.report.line_charts import method_colour
from stages.report.side_views import distance_note, frames_at, ground_of, points_of, shown_gap, side_view
from stages.shared.markup import Markup, joined, markup

POSES = 7
CELL, HEIGHT, LABEL, HEAD, GAP = 74, 132, 184, 30, 14
TRUTH_COLOUR, KEY_COLOUR = "#c4c4c4", "#b07a00"
COLOURS = ("#c2410c", "#1d4ed8", "#15803d", "#7e22ce")


class Palette(NamedTuple):
    """Colours of a picture: the paper, the truth, keys, methods in turn, notes, the ground and titles."""

    paper: str = "#ffffff"
    truth: str = TRUTH_COLOUR
    key: str = KEY_COLOUR
    methods: tuple[str, ...] = COLOURS
    note: str = "#666666"
    ground: str = "#dddddd"
    title: str = "#000000"


PAPER = Palette()  # of a picture file
PAGE = Palette(  # of a picture in a page, which may be light or dark
    "none",
    "var(--grid)",
    "var(--key)",
    tuple(map(method_colour, range(40))),
    "var(--dim)",
    "var(--rule)",
    "var(--text)",
)


def strips_svg(scenes: Sequence[dict], palette: Palette = PAPER) -> Markup:
    """The SVG of scenes as the page has them (`stages.report.scenes`): a row for each scene, a strip for each motion.

    The strips of a single scene stand below each other, so that they stay large on a page of text.
    """
    count = max(max(len(scene["motions"]) for scene in scenes) - 1, 1)
    rows, columns = (count, 1) if len(scenes) == 1 else (len(scenes), count)
    width = LABEL + columns * (POSES * CELL + GAP)
    parts = [
        markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {} {}" width="{}" font-family="sans-serif" '
            'font-size="12">', width, HEAD + rows * (HEIGHT + GAP), width,
        ),
        markup('<rect width="100%" height="100%" fill="{}"/>', palette.paper),
        markup(
            '<text x="8" y="18" fill="{}">grey: {}; <tspan fill="{}">amber: keys</tspan></text>',
            palette.note, scenes[0]["motions"][0]["name"], palette.key,
        ),
    ]  # fmt: skip
    for row, scene in enumerate(scenes):
        parts += _scene(scene, HEAD + row * (HEIGHT + GAP), stacked=len(scenes) == 1, palette=palette)
    return joined([*parts, markup("</svg>\n")], "\n")


def farthest(scenes: Sequence[dict]) -> dict:
    """The scene in whose shown gap the truth travels furthest."""
    return max(scenes, key=_travelled)


def _travelled(scene: dict) -> float:
    points = points_of(scene["motions"][0])
    first, last = shown_gap(points, scene["keys"])
    return float(np.linalg.norm(np.diff(points[first : last + 1], axis=0), axis=-1).mean(axis=1).sum())


def _scene(scene: dict, top: int, *, stacked: bool, palette: Palette) -> list[Markup]:
    truth, *others = scene["motions"]
    true = points_of(truth)
    first, last = shown_gap(true, scene["keys"])
    frames = np.linspace(first, last, POSES).round().astype(int)
    view = side_view(true[first : last + 1], truth["root"])
    span = (true[first : last + 1] - ground_of(true, truth["root"])[first : last + 1]) @ view
    floor = scene["floor"]
    scale = min((HEIGHT - 26) / max(span[..., 1].max() - floor, 0.1), 1.25 * CELL / max(np.ptp(span[..., 0]), 0.1))
    detail = scene["detail"]
    parts = [
        markup('<text x="8" y="{}" fill="{}" font-weight="600">{}</text>', top + 40, palette.title, scene["title"])
    ]
    parts += [markup('<text x="8" y="{}" fill="{}">{}</text>', top + 56, palette.note, detail)] if detail else []
    caption = f"frames {first} to {last} at {truth['fps']:.0f} a second"
    parts.append(markup('<text x="8" y="{}" fill="{}" font-size="10">{}</text>', top + 72, palette.note, caption))
    for column, motion in enumerate(others):
        left = LABEL + (0 if stacked else column * (POSES * CELL + GAP))
        base = top + HEIGHT - 18 + (column * (HEIGHT + GAP) if stacked else 0)
        made, colour = points_of(motion), palette.methods[column % len(palette.methods)]
        moments = frames_at(truth, motion, frames)
        parts.append(markup('<path d="M{} {}H{}" stroke="{}"/>', left, base, left + POSES * CELL, palette.ground))
        for pose, (frame, moment) in enumerate(zip(frames, moments, strict=True)):
            middle = left + (pose + 0.5) * CELL
            away = ground_of(true, truth["root"])[frame]
            shade = palette.key if frame in scene["keys"] else colour
            for data, points, stroke, thick in (
                (truth, true[frame], palette.truth, 4.0),
                (motion, made[moment], shade, 1.8),
            ):
                flat = (points - away) @ view
                places = np.stack([middle + scale * flat[:, 0], base - scale * (flat[:, 1] - floor)], axis=1)
                parts.append(_pose_svg(data["edges"], places, stroke, thick, 0.09 * scale))
        note = distance_note(truth, motion, np.arange(first + 1, last))
        parts.append(
            markup('<text x="{}" y="{}" fill="{}" font-size="11">{}</text>', left + 4, base + 14, colour, note)
        )
    return parts


def _pose_svg(edges: Sequence[Sequence[int]], places: np.ndarray, colour: str, thick: float, head: float) -> Markup:
    """One pose: a line a bone, fingers left out, a ring at the head's tip."""
    lines = "".join(
        f"M{places[a, 0]:.1f} {places[a, 1]:.1f}L{places[b, 0]:.1f} {places[b, 1]:.1f}"
        for a, b, _, thin, ball in edges
        if not thin and not ball
    )
    balls = [
        markup('<circle cx="{:.1f}" cy="{:.1f}" r="{:.1f}"/>', *places[[a, b]].mean(axis=0), head)
        for a, b, _, _, ball in edges
        if ball
    ]
    look = markup('fill="none" stroke="{}" stroke-width="{}" stroke-linecap="round"', colour, thick)
    return markup('<g {}><path d="{}"/>{}</g>', look, lines, balls)
