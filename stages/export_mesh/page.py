"""A page that plays meshes: positions of 16 bits, in base64, drawn by WebGL; it opens without a network."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stages.shared.markup import filled, own_file, script_data

_ASSETS = Path(__file__).parent / "assets"
_STEPS = 65535


@dataclass(frozen=True)
class Played:
    """One sequence: the clip's and the artefact's name, vertices (T, N, 3) metres, frames a second."""

    clip: str
    whose: str
    vertices: np.ndarray
    fps: float


def page_of(sequences: list[Played], faces: dict[str, np.ndarray], title: str) -> bytes:
    """The page's bytes.

    Args:
        faces: for the name of each artefact its triangles (F, 3).
    """
    scenes: dict[str, list[dict]] = {}
    for each in sequences:
        scenes.setdefault(each.clip, []).append(_packed(each))
    data = {"scenes": scenes, "faces": {name: _text(part.astype("<u4")) for name, part in faces.items()}}
    page = filled(
        own_file(_ASSETS / "meshes.html"),
        title=title,
        script=own_file(_ASSETS / "meshes.js"),
        data=script_data(data),
    )
    return page.encode("utf-8")


def _packed(played: Played) -> dict:
    low, high = played.vertices.min(axis=(0, 1)), played.vertices.max(axis=(0, 1))
    scale = np.maximum(high - low, 1e-6) / _STEPS
    values = np.round((played.vertices - low) / scale).astype("<u2")
    return {
        "whose": played.whose, "fps": played.fps, "frames": len(values), "low": low.tolist(), "scale": scale.tolist(),
        "data": _text(values),
    }  # fmt: skip


def _text(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
