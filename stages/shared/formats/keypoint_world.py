"""Places in 3D for `pumps estimate`: MediaPipe's world landmarks, and any motion that pumps reads."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.joint_lists import LISTS
from stages.shared.formats.keypoint_json import MOST_JSON_BYTES, WORLD_NAMES, parsed_json
from stages.shared.formats.keypoints import MOST_POINTS
from stages.shared.formats.positions import read_positions
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.sources import source_named


def places_in(path: str, layout: str | None, fps: float | None) -> Recording:
    """The one clip of a file of places in 3D, or of any other motion.

    Args:
        layout: the name of a joint list or a rig's file, for files without names.
    Raises: InputError naming the file.
    """
    source = source_named(path)
    data = source.read()
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"[") and any(
        key.encode() in data for key in WORLD_NAMES
    ):
        asked = Asked(fps_override=fps, rig_name=layout or "mediapipe33")
        return read_positions(_npy_of_world(data, source.name), source.name, asked)[0]
    rig, rig_name = (b"", "") if layout is None else (b"", layout) if layout in LISTS else rig_named(layout)
    found = recordings_in(source, Asked(fps_override=fps, rig=rig, rig_name=rig_name))
    if len(found) != 1:
        raise InputError(f"{source.name} holds {len(found)} clips, and one is put on a rig.", "`pumps export` one.")
    return found[0]


def _npy_of_world(data: bytes, name: str) -> bytes:
    """The world landmarks of all frames as the bytes of an array (T, K, 3), Y up; MediaPipe's y points down."""
    if len(data) > MOST_JSON_BYTES:
        raise InputError(
            f"{name} has {len(data) / 1e6:.0f} MB, which is too much for landmarks in JSON.", "Split it."
        )
    raw = parsed_json(data, name)
    frames = raw.get("frames", raw.get("results", [raw])) if isinstance(raw, dict) else raw
    rows = [_points_of(frame) for frame in frames] if isinstance(frames, list) else []
    counts = {len(row) for row in rows if row}
    if len(counts) != 1:
        raise InputError(
            f"{name}: its frames hold {sorted(counts) or 'no'} world landmarks.", "Give those of one person."
        )
    count = counts.pop()
    if count > MOST_POINTS:
        raise InputError(f"{name} has {count} landmarks; pumps reads at most {MOST_POINTS}.")
    places = np.full((len(rows), count, 3), np.nan)
    try:
        for number, row in enumerate(rows):
            if row:
                places[number] = [[float(point["x"]), -float(point["y"]), -float(point["z"])] for point in row]
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError(f"{name}: a world landmark has no x, y and z.") from None
    stream = io.BytesIO()
    np.save(stream, places)
    return stream.getvalue()


def _points_of(frame: Any) -> list[Any]:
    found = next((frame[key] for key in WORLD_NAMES if key in frame), None) if isinstance(frame, dict) else None
    if isinstance(found, list) and found and isinstance(found[0], list):
        found = found[0]
    if isinstance(found, dict):
        found = found.get("landmark", found.get("landmarks"))
    return found if isinstance(found, list) else []
