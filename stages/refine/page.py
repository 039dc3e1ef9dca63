"""The page of refined motions: film strips of each motion before and after, with its anchors and their scores."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stages.refine.config import Config
from stages.shared.concepts.body_positions import relative_poses
from stages.shared.concepts.pose_pictures import COLOURS, figure
from stages.shared.inference.refined_motion import Refined
from stages.shared.markup import Markup, joined, markup
from stages.shared.settings.command_line import command_line

_POSES = 14  # shown of a motion, besides its anchors
_CELL, _HEIGHT = 74, 150
_BLUE, _RED, _GREY = COLOURS[0], COLOURS[1], "#9a9a9a"


def page_of(motions: Sequence[tuple[str, str, Refined]], config: Config, fps: float) -> bytes:
    """The page as bytes of HTML that opens offline.

    Args:
        motions: name, action and what was refined. fps: the networks' rate.
    """
    parts = [
        markup(
            "<h2>{}: {}</h2><p>{} of {} anchors were judged flawed; joints moved by {} mm (mean).</p>{}",
            action, name, int(each.found.flawed.sum()), len(each.found.anchors),
            f"{each.moved_mm:.0f}", _strips(each, fps),
        )
        for name, action, each in motions
    ]  # fmt: skip
    page = markup(
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Refined motions</title><style>'
        "body{{font-family:sans-serif;margin:2em}}</style></head><body><h1>Refined motions</h1>"
        "<p>Poses of each motion, turned to face the same way: above as it was given, below refined. Thick poses are "
        "anchors with their quality scores: blue ones were judged good, red ones flawed. Made by:</p><pre>{}</pre>{}"
        "</body></html>\n",
        command_line("pumps refine", config, arguments=("input",)), joined(parts, "\n"),
    )  # fmt: skip
    return page.encode()


def _strips(each: Refined, fps: float) -> Markup:
    frames = len(each.given)
    shown = np.union1d(np.linspace(0, frames - 1, min(_POSES, frames)).astype(int), each.found.anchors)
    scores = dict(zip(each.found.anchors.tolist(), each.found.scores.tolist(), strict=True))
    flawed = set(each.found.anchors[each.found.flawed].tolist())
    parts = []
    for place, frame in enumerate(shown.tolist()):
        colour = _RED if frame in flawed else _BLUE if frame in scores else _GREY
        x = (place + 0.5) * _CELL
        for row, positions in enumerate((each.given, each.found.positions)):
            pose = relative_poses(positions[frame : frame + 1], each.body.groups)[0]
            parts.append(figure(pose, each.body.parents, x, 18 + (row + 0.5) * _HEIGHT, colour, frame in scores))
        text = f"{frame / fps:.2f} s" + (f" {scores[frame]:.0f}" if frame in scores else "")
        parts.append(markup('<text x="{:.0f}" y="12" text-anchor="middle" fill="{}">{}</text>', x, colour, text))
    return markup(
        '<svg xmlns="http://www.w3.org/2000/svg" width="{}" height="{}" font-size="11">{}</svg>',
        len(shown) * _CELL, 2 * _HEIGHT + 24, joined(parts),
    )  # fmt: skip
