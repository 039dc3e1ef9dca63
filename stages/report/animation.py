"""The player's scenes as one moving picture: keys, then each motion over the truth. An SVG that plays by itself.

A row is a scene, which repeats in real time; a column is a motion. All figures of a row are seen from one side, and
move with the truth's pelvis, so that a motion's drift shows as such; marks on the ground move past. Readers who asked
their system for less motion see one pose between two keys instead, which does not move.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stages.report.side_views import distance_note, frames_at, ground_of, points_of, shown_gap, side_view
from stages.report.strips import PAPER
from stages.shared.markup import Markup, joined, markup

TEXT = 16  # pixels; a phone shows three columns at two thirds of their size
LEFT, CELL, HEIGHT, HEAD, TITLE, GAP = 8, 178, 198, 32, 24, 12
BELOW, ABOVE = 54, 8  # of the ground: the timeline and two lines; of the tallest pose: air
MARK_M = 0.5  # metres between marks on the ground
SHARPNESS = 10  # coordinates are whole numbers of tenths of a pixel
STYLE = markup(
    "<style>path{{fill:none;stroke-linecap:round;stroke-linejoin:round}}.still{{display:none}}"
    "@media (prefers-reduced-motion:reduce){{.moving{{display:none}}.still{{display:inline}}}}</style>"
)


@dataclass(frozen=True)
class _Row:
    """A scene on its way to the picture.

    places: for each motion, the truth first, (T, N, 2) tenths of a pixel around the cell's ground.
    travelled: (T,) tenths of a pixel, the truth's way along the ground. scale: tenths of a pixel in a metre.
    gap: the frames at the ends of the gap that is shown where nothing may move. number: of the row.
    """

    number: int
    scene: dict
    places: list[np.ndarray]
    travelled: np.ndarray
    scale: float
    gap: tuple[int, int]

    @property
    def seconds(self) -> float:
        truth = self.scene["motions"][0]
        return truth["frames"] / truth["fps"]

    @property
    def keys(self) -> list[int]:
        return self.scene["keys"]


def animation_svg(scenes: Sequence[dict]) -> Markup:
    """The SVG of scenes as the page has them (`stages.report.drawings.scene_of`).

    A motion at another rate than the truth's is drawn at the truth's frames.
    """
    columns = max(len(scene["motions"]) for scene in scenes)
    row = TITLE + HEIGHT + GAP
    width, height = LEFT + columns * CELL, HEAD + len(scenes) * row
    truth = scenes[0]["motions"][0]["name"]
    return joined(
        [
            markup(
                '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {} {}" width="{}" font-family="sans-serif" '
                'font-size="{}">', width, height, width, TEXT,
            ),
            STYLE,
            markup('<rect width="100%" height="100%" fill="{}"/>', PAPER.paper),
            markup(
                '<text x="8" y="20" fill="{}"><tspan fill="{}">amber: keys, the only poses that are read;</tspan>'
                " grey: {}</text>",
                PAPER.note, PAPER.key, truth,
            ),
            *(_row_svg(_row(number, scene), HEAD + number * row) for number, scene in enumerate(scenes)),
            markup("</svg>\n"),
        ],
        "\n",
    )  # fmt: skip


def _row(number: int, scene: dict) -> _Row:
    truth = scene["motions"][0]
    frames = np.arange(truth["frames"])
    points = [points_of(motion)[frames_at(truth, motion, frames)] for motion in scene["motions"]]
    root = scene["motions"][0]["root"]
    view, ground = side_view(points[0], root), ground_of(points[0], root)
    flat = [(each - ground) @ view for each in points]
    tall = max(each[..., 1].max() for each in flat) - scene["floor"]
    wide = 2 * max(np.abs(each[..., 0]).max() for each in flat)
    scale = SHARPNESS * min((HEIGHT - BELOW - ABOVE) / max(tall, 0.1), 0.96 * CELL / max(wide, 0.1))
    places = [(each - [0.0, scene["floor"]]) * [scale, -scale] for each in flat]
    return _Row(
        number, scene, [each.round().astype(int) for each in places], scale * (ground[:, 0] @ view[:, 0]), scale,
        shown_gap(points[0], scene["keys"]),
    )  # fmt: skip


def _row_svg(row: _Row, top: int) -> Markup:
    scene, base = row.scene, top + TITLE + HEIGHT - BELOW
    truth, *others = scene["motions"]
    parts = [
        markup(
            '<text x="8" y="{}" fill="{}"><tspan fill="{}" font-weight="600">{}</tspan> {}</text>',
            top + 18,
            PAPER.note,
            PAPER.title,
            scene["title"],
            scene["detail"],
        )
    ]
    given = f"keys: {len(row.keys)} of {truth['frames']} frames"
    parts.append(_cell(row, LEFT, base, _keys_svg(row), given, PAPER.key))
    missing = np.setdiff1d(np.arange(truth["frames"]), row.keys)
    for column, motion in enumerate(others):
        colour = PAPER.methods[column % len(PAPER.methods)]
        figures = joined([_truth_svg(row, drawn=column > 0), _motion_svg(row, column + 1, colour, 2.2)])
        note = distance_note(truth, motion, missing)
        parts.append(_cell(row, LEFT + (column + 1) * CELL, base, figures, note, colour))
    return joined(parts)


def _cell(row: _Row, left: int, base: int, figures: Markup, note: str, colour: str) -> Markup:
    """Figures on the ground, with the timeline and a note, NAME: FACT, in two lines below them."""
    right, middle = left + CELL - 14, left + (CELL - 14) / 2
    dash = MARK_M * row.scale / SHARPNESS
    name, _, fact = note.partition(": ")
    offsets = _list(f"{each / SHARPNESS:.1f}" for each in row.travelled)
    ground = markup(
        '<path class="moving" d="M{} {}H{}" stroke="{}" stroke-width="3" stroke-dasharray="0 {:.1f}">{}</path>',
        left + 6, base + 4, right - 6, PAPER.note, dash,
        markup(
            '<animate attributeName="stroke-dashoffset" dur="{:.3f}s" repeatCount="indefinite" values="{}"/>',
            row.seconds, offsets,
        ),
    )  # fmt: skip
    return joined([
        markup('<path d="M{} {}H{}" stroke="{}"/>', left, base + 2, right, PAPER.ground), ground,
        _timeline(row, left, right, base + 13),
        markup('<g transform="translate({} {}) scale({})">{}</g>', middle, base, 1 / SHARPNESS, figures),
        markup(
            '<text x="{}" y="{}" fill="{}">{}<tspan x="{}" dy="18">{}</tspan></text>',
            left, base + 32, colour, f"{name}: " if fact else name, left, fact,
        ),
    ])  # fmt: skip


def _timeline(row: _Row, left: float, right: float, at: float) -> Markup:
    """A mark for each key, and one that moves."""
    last = max(len(row.places[0]) - 1, 1)
    ticks = "".join(f"M{left + key / last * (right - left):.1f} {at - 2}v4" for key in row.keys)
    return joined([
        markup('<path d="{}" stroke="{}" stroke-width="1.5" stroke-linecap="butt"/>', ticks, PAPER.key),
        markup(
            '<circle class="moving" cx="{}" cy="{}" r="2.5" fill="{}"><animate attributeName="cx" dur="{:.3f}s" '
            'repeatCount="indefinite" values="{};{}"/></circle>',
            left, at, PAPER.note, row.seconds, left, right,
        ),
    ])  # fmt: skip


def _truth_svg(row: _Row, *, drawn: bool) -> Markup:
    """The truth of a row: written in the first cell that has it, and repeated by its name in the others."""
    if drawn:
        return markup('<use href="#truth-{}"/>', row.number)
    return markup('<g id="truth-{}">{}</g>', row.number, _motion_svg(row, 0, PAPER.truth, 4.5))


def _motion_svg(row: _Row, which: int, colour: str, thick: float) -> Markup:
    """A motion that plays, and the pose in the middle of the gap that is shown where nothing may move."""
    edges, places = row.scene["motions"][which]["edges"], row.places[which]
    first, last = row.gap
    stroke = markup('stroke="{}" stroke-width="{}"', colour, thick * SHARPNESS)
    ball = markup('stroke="{}" stroke-width="{:.0f}"', colour, 0.17 * row.scale)
    bones = [_bones(edges, pose) for pose in places]
    heads = [_head(edges, pose) for pose in places]
    still = (first + last) // 2
    return joined([
        markup('<g class="moving"><path {}>{}</path><path {}>{}</path></g>', stroke, _played(row, bones), ball,
               _played(row, heads)),
        markup('<g class="still"><path {} d="{}"/><path {} d="{}"/></g>', stroke, bones[still], ball, heads[still]),
    ])  # fmt: skip


def _keys_svg(row: _Row) -> Markup:
    """The last key's pose, until the next key; where nothing may move, both poses beside the gap that is shown."""
    edges, keys = row.scene["motions"][0]["edges"], row.keys
    stroke = markup('stroke="{}" stroke-width="{}"', PAPER.key, 2.2 * SHARPNESS)
    ball = markup('stroke="{}" stroke-width="{:.0f}"', PAPER.key, 0.17 * row.scale)
    bones, heads = ({key: draw(edges, row.places[0][key]) for key in keys} for draw in (_bones, _head))
    stills = [key for key in row.gap if key in bones]
    return joined([
        markup('<g class="moving"><path {}>{}</path><path {}>{}</path></g>', stroke,
               _played(row, [*bones.values()], keys), ball, _played(row, [*heads.values()], keys)),
        markup('<g class="still"><path {} d="{}"/><path {} d="{}"/></g>', stroke,
               "".join(bones[key] for key in stills), ball, "".join(heads[key] for key in stills)),
    ])  # fmt: skip


def _played(row: _Row, outlines: Sequence[str], keys: Sequence[int] | None = None) -> Markup:
    """The animation of a path through outlines: one a frame, or one a key, each until the next."""
    frames = len(row.places[0])
    steps = markup("")
    if keys is not None:
        starts = [0, *keys[1:]]  # the first pose also stands before its key
        steps = markup(' calcMode="discrete" keyTimes="{}"', _list(f"{key / frames:.5g}" for key in starts))
    return markup(
        '<animate attributeName="d" dur="{:.3f}s" repeatCount="indefinite"{} values="{}"/>',
        row.seconds, steps, _list(outlines),
    )  # fmt: skip


def _list(values: Iterable[str]) -> str:
    return ";".join(values)


def _bones(edges: Sequence[Sequence[int]], pose: np.ndarray) -> str:
    """A line for each bone; those of fingers are left out."""
    parts = []
    for start, end, _, thin, ball in edges:
        if not thin and not ball:
            (x, y), (across, up) = pose[start], pose[end] - pose[start]
            parts.append(f"M{x} {y}l{across} {up}")
    return "".join(parts)


def _head(edges: Sequence[Sequence[int]], pose: np.ndarray) -> str:
    """A line without length, whose round ends are the head."""
    balls = [pose[[start, end]].mean(axis=0) for start, end, _, _, ball in edges if ball]
    return "".join(f"M{x:.0f} {y:.0f}h0" for x, y in balls) or "M0 0"
