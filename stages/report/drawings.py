"""Motions as the page holds them: scenes of several motions side by side."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.shared.humanoid.stick_figure import StickFigure


@dataclass(frozen=True)
class Heading:
    """What a scene is called: a title, and in smaller letters a detail, which may be ""."""

    title: str
    detail: str = ""

    @property
    def name(self) -> str:
        """Both in one line."""
        return f"{self.title}: {self.detail}" if self.detail else self.title


def heading_of(given: str) -> Heading:
    """The heading that the user wrote as `TITLE` or `TITLE: DETAIL`."""
    title, _, detail = given.partition(": ")
    return Heading(title, detail)


@dataclass(frozen=True)
class Drawing:
    """A motion as it is drawn: its figure, `fps` frames a second."""

    name: str
    fps: float
    figure: StickFigure


def scene_of(heading: Heading, keys: Sequence[int] | np.ndarray, drawings: Sequence[Drawing]) -> dict:
    """A scene as plain data for the page; the first motion is the true one, whose frames `keys` were known."""
    first = drawings[0].figure
    origin = first.ground_centre()
    return {
        "name": heading.name,
        "title": heading.title,
        "detail": heading.detail,
        "keys": [int(key) for key in keys if key < len(first.points)],
        "floor": round(first.floor_m, 4),
        "height": round(first.height_m, 4),
        "size": round(first.size_m, 4),
        "motions": [_packed(drawing, origin) for drawing in drawings],
    }


def _packed(drawing: Drawing, origin: np.ndarray) -> dict:
    """A motion as the page holds it, its points around `origin` as 16-bit numbers."""
    figure = drawing.figure
    points, scale = figure.quantised(origin)
    return {
        "name": drawing.name,
        "fps": round(float(drawing.fps), 6),
        "frames": points.shape[0],
        "nodes": points.shape[1],
        "root": figure.root,
        "edges": figure.edges,
        "scale": scale,
        "points": base64.b64encode(points.tobytes()).decode(),
    }
