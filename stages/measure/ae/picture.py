"""Clouds as an SVG picture: a row for each, three frames seen from the front, and some points' paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from torch import Tensor

from data_schemas.skeleton import BODY_GROUPS
from stages.shared.markup import Markup, joined, markup

COLOURS = ("#404040", "#1f77b4", "#d62728", "#17a2a2", "#ff7f0e")  # in the order of BODY_GROUPS
_PIXELS_A_METRE = 110.0
_LABEL, _HEAD, _GAP = 120, 58, 8
_PATHS = 20  # number of points whose paths are drawn
_TURN = np.radians(25)  # slightly from the side, so that depth is visible
SPINE, LEFT_LEG, RIGHT_LEG = (BODY_GROUPS.index(name) for name in ("spine", "left_leg", "right_leg"))


class Panel(NamedTuple):
    """A cloud to draw, points (T, P, 3) metres, and what it is."""

    label: str
    points: Tensor


def cloud_picture(panels: Sequence[Panel], groups: Tensor, title: str) -> Markup:
    """The SVG text; all panels have the scale and the view of the first one."""
    kinds = groups.numpy()
    first = panels[0].points.double().numpy()
    view = _front_view(first, kinds)
    flat = [panel.points.double().numpy() @ view.T for panel in panels]
    # Room for all panels, but at most half a metre beyond the first, so that one bad cloud does not shrink all.
    low = np.maximum(np.min([each.min((0, 1)) for each in flat], axis=0), flat[0].min((0, 1)) - 0.5) - 0.05
    high = np.minimum(np.max([each.max((0, 1)) for each in flat], axis=0), flat[0].max((0, 1)) + 0.5) + 0.05
    width, height = ((high - low) * _PIXELS_A_METRE)[:2]
    frames = (0, first.shape[0] // 2, first.shape[0] - 1)
    left = [_LABEL + place * (width + _GAP) for place in range(4)]
    page = (left[-1] + width + _GAP, _HEAD + len(panels) * (height + _GAP))
    parts = [
        markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0:.0f} {1:.0f}" width="{0:.0f}" height="{1:.0f}" '
            'font-family="sans-serif" font-size="12">', *page,
        ),
        markup('<rect width="100%" height="100%" fill="#ffffff"/>'),
        markup('<text x="{}" y="16">{}</text>', _GAP, title),
    ]  # fmt: skip
    heads = [f"frame {frame + 1}" for frame in frames] + [f"paths of {min(_PATHS, len(kinds))} points"]
    parts += [
        markup('<text x="{:.0f}" y="52" fill="#555555">{}</text>', x, head)
        for x, head in zip(left, heads, strict=True)
    ]
    for group, (name, colour) in enumerate(zip(BODY_GROUPS, COLOURS, strict=True)):
        x = _LABEL + 72 * group
        parts.append(markup('<text x="{}" y="34" fill="{}">{}</text>', x, colour, name.replace("_", " ")))
    for row, (panel, cloud) in enumerate(zip(panels, flat, strict=True)):
        top = _HEAD + row * (height + _GAP)
        parts.append(markup('<text x="{}" y="{:.0f}">{}</text>', _GAP, top + height / 2, panel.label))
        pixels = np.stack([cloud[..., 0] - low[0], high[1] - cloud[..., 1]], axis=-1) * _PIXELS_A_METRE
        for x, frame in zip(left, frames, strict=False):
            parts += _dots(pixels[frame] + np.array([x, top]), kinds)
        parts += _paths(pixels + np.array([left[3], top]), kinds)
    return joined([*parts, markup("</svg>\n")], "\n")


def _front_view(points: np.ndarray, kinds: np.ndarray) -> np.ndarray:
    """(3, 3) rows right, up and towards the eye, of a view of the body's front; from the body groups alone."""
    middle = points.mean(0)
    across = np.array([1.0, 0.0, 0.0])
    if (kinds == LEFT_LEG).any() and (kinds == RIGHT_LEG).any():
        found = middle[kinds == LEFT_LEG].mean(0) - middle[kinds == RIGHT_LEG].mean(0)
        found[1] = 0
        if np.linalg.norm(found) > 1e-3:
            across = found / np.linalg.norm(found)
    up = np.array([0.0, 1.0, 0.0])
    towards = np.cross(across, up)
    right = across * np.cos(_TURN) + towards * np.sin(_TURN)
    return np.stack([right, up, np.cross(right, up)])


def _dots(pixels: np.ndarray, kinds: np.ndarray) -> list[Markup]:
    """A dot is a path of length zero with round ends, which is much shorter SVG than a circle."""
    parts = []
    for group, colour in enumerate(COLOURS):
        places = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in pixels[kinds == group])
        if places:
            parts.append(
                markup('<path d="{}" stroke="{}" stroke-width="2.6" stroke-linecap="round"/>', places, colour)
            )
    return parts


def _paths(pixels: np.ndarray, kinds: np.ndarray) -> list[Markup]:
    parts = []
    for point in range(0, len(kinds), max(1, -(-len(kinds) // _PATHS))):
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels[:, point])
        colour = COLOURS[kinds[point]]
        parts.append(markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="0.9"/>', line, colour))
    return parts
