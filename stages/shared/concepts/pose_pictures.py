"""Stick figures of poses as SVG."""

from __future__ import annotations

import numpy as np

from stages.shared.markup import Markup, joined, markup

COLOURS = (
    "#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17a2a2", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22",
)  # fmt: skip
_PIXELS_A_METRE = 72.0
_VIEW = np.radians(30)  # from the side of straight ahead


def figure(pose: np.ndarray, parents: np.ndarray, x: float, y: float, colour: str, strong: bool = False) -> Markup:
    """A stick figure of a pose (J, 3), the pelvis at (x, y) pixels."""
    across = np.cos(_VIEW) * pose[:, 0] + np.sin(_VIEW) * pose[:, 2]
    places = np.stack([x + _PIXELS_A_METRE * across, y - _PIXELS_A_METRE * pose[:, 1]], axis=1)
    lines = [
        markup('<line x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}"/>', *places[parents[joint]], *places[joint])
        for joint in range(1, len(parents))
    ]
    return markup(
        '<g stroke="{}" stroke-width="{}" stroke-linecap="round">{}</g>', colour, 3 if strong else 1.6, joined(lines)
    )
