"""The locality of bodies of parts as an SVG: for each body a square of tampered parts against harmed body groups."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from data_schemas.skeleton import BODY_GROUPS
from stages.shared.markup import Markup, joined, markup

_TITLE = "Row: part tampered with. Column: how far each body group moves, cm."
_CELL, _LABEL, _HEAD, _GAP, _COLUMNS = 54, 78, 92, 26, 4


def locality_picture(harms: Mapping[str, np.ndarray], pieces: Mapping[str, tuple[str, ...]]) -> Markup:
    """The SVG text. harms: name -> (pieces, 5) cm. All squares have one scale of colours."""
    most = max(float(each.max()) for each in harms.values()) or 1.0
    width, height = _LABEL + len(BODY_GROUPS) * _CELL + _GAP, _HEAD + len(BODY_GROUPS) * _CELL + _GAP
    rows = -(-len(harms) // _COLUMNS)
    page = (min(_COLUMNS, len(harms)) * width, 40 + rows * height)
    parts = [
        markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0} {1}" width="{0}" height="{1}" '
            'font-family="sans-serif" font-size="11">', *page,
        ),
        markup('<rect width="100%" height="100%" fill="#ffffff"/>'),
        markup('<text x="8" y="20" font-size="13">{}</text>', _TITLE),
    ]  # fmt: skip
    for index, (name, values) in enumerate(harms.items()):
        left, top = index % _COLUMNS * width, 40 + index // _COLUMNS * height
        parts.append(markup('<text x="{}" y="{}" font-weight="bold">{}</text>', left + _LABEL, top + 14, name))
        for column, group in enumerate(BODY_GROUPS):
            x, y = left + _LABEL + column * _CELL + _CELL // 2, top + _HEAD - 8
            words = group.replace("_", " ")
            parts.append(markup('<text x="{0}" y="{1}" transform="rotate(-50 {0} {1})">{2}</text>', x, y, words))
        for row, (piece, line) in enumerate(zip(pieces[name], values, strict=True)):
            y = top + _HEAD + row * _CELL
            words = piece.replace("_", " ")
            parts.append(
                markup(
                    '<text x="{}" y="{}" text-anchor="end">{}</text>', left + _LABEL - 6, y + _CELL // 2 + 4, words
                )
            )
            for column, value in enumerate(line):
                parts += _cell(left + _LABEL + column * _CELL, y, float(value), most)
    return joined([*parts, markup("</svg>\n")], "\n")


def _cell(x: int, y: int, value: float, most: float) -> list[Markup]:
    share = value / most
    shade = [round(255 + share * (dark - 255)) for dark in (178, 24, 43)]
    ink = "#ffffff" if share > 0.6 else "#222222"
    return [
        markup(
            '<rect x="{0}" y="{1}" width="{2}" height="{2}" fill="rgb({3},{4},{5})" stroke="#dddddd"/>',
            x, y, _CELL, *shade,
        ),
        markup(
            '<text x="{}" y="{}" text-anchor="middle" fill="{}">{:.2f}</text>',
            x + _CELL // 2, y + _CELL // 2 + 4, ink, value,
        ),
    ]  # fmt: skip
