"""A film strip: frames of mesh sequences side by side, a row for each artefact, as an SVG that holds one PNG."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np

from data_schemas.errors import InputError
from stages.export_mesh.page import Played
from stages.export_mesh.raster import drawn, png_of, view_of
from stages.shared.markup import Markup, joined, markup

COLOURS = ((0.35, 0.55, 0.85), (0.95, 0.6, 0.25), (0.45, 0.7, 0.45), (0.75, 0.45, 0.7))
_YAW, _PITCH = 0.6, 0.15  # as the page begins
_HEIGHT, _WIDEST, _MARGIN_M, _HEAD, _LABEL = 190, 240, 0.03, 22, 18


def strip_of(sequences: Sequence[Played], faces: dict[str, np.ndarray], frames: np.ndarray, start: int) -> Markup:
    """The SVG text.

    Args:
        sequences: of one or several clips. faces: for the name of each artefact its triangles (F, 3).
        frames: (P,) of the sequences; where one is shorter, its last frame is shown again.
        start: the clip's frame that is the first of the sequences.

    Raises: InputError for sequences of several rates: their frames are not of the same times.
    """
    rates = sorted({each.fps for each in sequences})
    if len(rates) > 1:
        raise InputError(
            f"The clips have several rates ({', '.join(f'{rate:g}' for rate in rates)} frames a second), and a film "
            "strip shows the same times of all.",
            "Give clips of one rate.",
        )
    view = view_of(_YAW, _PITCH)
    shown = [each.vertices[np.minimum(frames, len(each.vertices) - 1)] @ view.T for each in sequences]
    low = np.min([each[..., :2].min((0, 1)) for each in shown], axis=0) - _MARGIN_M
    high = np.max([each[..., :2].max((0, 1)) for each in shown], axis=0) + _MARGIN_M
    scale = min(_HEIGHT / (high[1] - low[1]), _WIDEST / (high[0] - low[0]))
    width, height = (int(np.ceil(each)) for each in (high - low) * scale)
    names = list(dict.fromkeys(each.whose for each in sequences))
    rows = []
    for played, meshes in zip(sequences, shown, strict=True):
        look = (faces[played.whose], COLOURS[names.index(played.whose) % len(COLOURS)], (width, height), low, scale)
        rows.append(np.concatenate([drawn(mesh, *look) for mesh in meshes], axis=1))
    band = height + _LABEL
    page = (len(frames) * width, _HEAD + len(rows) * band)
    parts = [
        markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0} {1}" width="{0}" height="{1}" '
            'font-family="sans-serif" font-size="12">', *page,
        ),
        markup('<rect width="100%" height="100%" fill="#ffffff"/>'),
    ]  # fmt: skip
    for column, frame in enumerate(frames.tolist()):
        seconds = (start + frame) / rates[0]
        words = (column * width + width // 2, f"{seconds:.2f} s")
        parts.append(markup('<text x="{}" y="15" text-anchor="middle" fill="#555555">{}</text>', *words))
    for row, (played, pixels) in enumerate(zip(sequences, rows, strict=True)):
        top = _HEAD + row * band
        parts.append(markup('<text x="4" y="{}">{}</text>', top + 13, f"{played.whose} ({played.clip})"))
        data = base64.b64encode(png_of(pixels)).decode("ascii")
        parts.append(
            markup(
                '<image x="0" y="{}" width="{}" height="{}" href="data:image/png;base64,{}"/>',
                top + _LABEL, page[0], height, data,
            )
        )  # fmt: skip
    return joined([*parts, markup("</svg>\n")], "\n")
