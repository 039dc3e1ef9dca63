"""A body with further limbs as an SVG: a few frames side by side, the added joints in another colour."""

from __future__ import annotations

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.forward import positions_of
from stages.shared.markup import Markup, joined, markup

_FRAMES, _PIXELS_A_METRE, _GAP = 5, 130.0, 24
_OWN, _ADDED = "#1f4e9c", "#17a2c2"


def body_picture(skeleton: Skeleton, motion: Motion, added: frozenset[str]) -> Markup:
    """The SVG text; frames are spread over the motion, each seen from the side of +Z with the pelvis in the middle.

    added: names of the joints that are drawn in the second colour.
    """
    frames = np.unique(np.linspace(0, motion.frames - 1, _FRAMES).round().astype(int))
    places = positions_of(skeleton, motion.at(frames))
    body = np.flatnonzero(np.asarray(skeleton.groups) >= 0)
    flat = places[..., :2] - places[:, [skeleton.root], :2] * np.array([1.0, 0.0])
    low, high = flat[:, body].min((0, 1)) - 0.05, flat[:, body].max((0, 1)) + 0.05
    width, height = (high - low) * _PIXELS_A_METRE
    page = (len(frames) * (width + _GAP), height + 2 * _GAP)
    parts = [
        markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0:.0f} {1:.0f}" width="{0:.0f}" '
            'height="{1:.0f}" font-family="sans-serif" font-size="12">',
            *page,
        ),
        markup('<rect width="100%" height="100%" fill="#ffffff"/>'),
    ]
    for index, (frame, points) in enumerate(zip(frames, flat, strict=True)):
        left = index * (width + _GAP) + _GAP / 2
        x = left + (points[:, 0] - low[0]) * _PIXELS_A_METRE
        y = _GAP + (high[1] - points[:, 1]) * _PIXELS_A_METRE
        parts.append(markup('<text x="{:.0f}" y="14" fill="#555555">frame {}</text>', left, frame + 1))
        for joint in body[1:]:
            above = int(skeleton.parents[joint])
            colour = _ADDED if skeleton.names[joint] in added else _OWN
            line = (x[above], y[above], x[joint], y[joint], colour)
            parts.append(
                markup('<path d="M{:.1f} {:.1f}L{:.1f} {:.1f}" stroke="{}" stroke-width="3" fill="none"/>', *line)
            )
    return joined([*parts, markup("</svg>\n")], "\n")
