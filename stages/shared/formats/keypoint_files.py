"""2D keypoints from a file, a folder or an archive of any pose detector that pumps knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.archives import archive_suffix
from stages.shared.formats.arrays import array_names, read_array, read_arrays
from stages.shared.formats.keypoint_json import WORLD_NAMES, frames_of_files, read_json
from stages.shared.formats.keypoint_layouts import LAYOUTS
from stages.shared.formats.keypoints import MOST_POINTS, Detection, Detections, Keypoints, person_of, sound_points
from stages.shared.formats.positions_csv import lines_of, numbers_of
from stages.shared.formats.sources import find_sources, source_named
from stages.shared.formats.text_cells import texts_of_line

_PLACES = ("keypoints", "keypoints_2d", "keypoints2d", "positions_2d", "poses_2d", "joints_2d")
_SCORES = ("keypoint_scores", "scores", "confidences", "confidence")
_MOST_FILES = 500_000


def read_keypoints(
    path: str, *, person: int = 0, layout: str | None = None, size: tuple[float, float] | None = None
) -> Keypoints:
    """One person's keypoints from a file, or from a folder or archive of one file a frame (OpenPose).

    Args: as `stages.shared.formats.keypoints.person_of` takes them.
    Raises: InputError naming the file.
    """
    if _holds_files(path):
        sources = sorted(find_sources([path], (".json",)), key=lambda source: source.name)
        if len(sources) > _MOST_FILES:
            raise InputError(
                f"{path} holds {len(sources)} files, and one video has no more than {_MOST_FILES} frames."
            )
        found = frames_of_files((source.name, source.read()) for source in sources)
        name = path
    else:
        source = source_named(path)
        found, name = detections_in(source.read(), source.name), source.name
    return person_of(found, name, person=person, layout=layout, size=size)


def _holds_files(path: str) -> bool:
    """Whether a path is that of a folder or archive."""
    return Path(path).is_dir() or bool(archive_suffix(path))


def detections_in(data: bytes, name: str) -> Detections:
    """The people in a file, by its content. Raises InputError naming the file."""
    if data.startswith(b"PK") or data.startswith(b"\x93NUMPY"):
        return _of_arrays(data, name)
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"["):
        return read_json(data, name)
    return _of_deeplabcut(data, name)


def looks_like_keypoints(data: bytes, name: str) -> bool:
    """Whether a file holds 2D keypoints, as far as its start shows; files of 3D places do not."""
    if data.startswith(b"PK"):
        listed = array_names(data, name)
        return any(key in listed for key in _PLACES) and "poses" not in listed
    if data.startswith(b"\x93NUMPY"):
        shape = read_array(data, name).shape
        return len(shape) == 3 and (shape[2] == 2 or (shape[2] == 3 and shape[1] in map(len, LAYOUTS.values())))
    head = data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()
    if head[:1] in (b"{", b"["):
        places = any(word in head for word in (b'"Frames"', b'"asset"'))
        return not places and not any(key.encode() in data for key in WORLD_NAMES)
    return head[:6].lower() in (b"scorer", b"bodypa")


def _of_arrays(data: bytes, name: str) -> Detections:
    names: tuple[str, ...] = ()
    size, fps, scores = None, None, None
    if data.startswith(b"PK"):
        listed = array_names(data, name)
        key = next((key for key in _PLACES if key in listed), None)
        if key is None:
            raise InputError(f"{name} holds no array of 2D keypoints.", f"Call it one of {', '.join(_PLACES)}.")
        arrays, _ = read_arrays(data, name, (key, *_SCORES, "names", "fps", "image_size"))
        if key not in arrays:
            raise InputError(f"{name}: its array '{key}' is pickled.", "Save it as plain numbers.")
        places = arrays[key]
        scores = next((arrays[each] for each in _SCORES if each in arrays), None)
        if "names" in arrays and arrays["names"].dtype.kind == "U":
            names = tuple(str(each)[:60] for each in arrays["names"].ravel()[: MOST_POINTS + 1])
        size = _pair(arrays.get("image_size"))
        rate = arrays.get("fps")
        if (
            rate is not None
            and rate.size == 1
            and rate.dtype.kind in "iuf"
            and 0.1 <= float(rate.reshape(-1)[0]) <= 1e4
        ):
            fps = float(rate.reshape(-1)[0])
    else:
        places = read_array(data, name)
    if places.ndim == 4 and places.shape[0] == 1:
        places = places[0]
    if places.ndim != 3 or places.shape[2] not in (2, 3) or places.dtype.kind not in "iuf" or 0 in places.shape:
        raise InputError(
            f"{name} has the shape {places.shape}, expected frames, keypoints and 2 (or 3: with confidence)."
        )
    if places.shape[1] > MOST_POINTS:
        raise InputError(f"{name} has {places.shape[1]} keypoints; pumps reads at most {MOST_POINTS}.")
    points = np.ones((*places.shape[:2], 3))
    points[..., : places.shape[2]] = places
    if scores is not None:
        if scores.dtype.kind not in "iuf" or scores.size != places.shape[0] * places.shape[1]:
            raise InputError(
                f"{name} has keypoints of shape {places.shape[:2]} (frames, points) but confidences of shape "
                f"{scores.shape}.",
                "Give one confidence for each point of each frame, or leave them out.",
            )
        points[..., 2] = scores.reshape(places.shape[:2])
    frames = {at: [Detection(sound_points(points[at]))] for at in range(len(points))}
    if names and len(names) != places.shape[1]:
        raise InputError(f"{name} has {places.shape[1]} keypoints but {len(names)} names.")
    return Detections(frames, names, size, fps=fps)


def _pair(values: np.ndarray | None) -> tuple[float, float] | None:
    if values is None or values.size != 2 or values.dtype.kind not in "iuf":
        return None
    width, height = (float(each) for each in values.ravel())
    return (width, height) if 1 <= width <= 1e6 and 1 <= height <= 1e6 else None


def _of_deeplabcut(data: bytes, name: str) -> Detections:
    """DeepLabCut's CSV: lines of scorer, (individuals,) body parts and coordinates, then one line a frame."""
    head: dict[str, list[str]] = {}
    lines = lines_of(data)
    for number, line in lines:
        cells = texts_of_line(line.removeprefix("\ufeff"), ",")
        label = cells[0].lower()
        if label not in ("scorer", "individuals", "bodyparts", "coords"):
            first = number, line
            break
        if len(cells) > 3 * MOST_POINTS * 20:
            raise InputError(f"{name}, line {number}: there are {len(cells)} columns, which is too many.")
        head[label] = cells[1:]
    else:
        first = None
    if "bodyparts" not in head or "coords" not in head:
        raise InputError(
            f"{name} is of no pose detector that pumps knows.",
            "Give the JSON of OpenPose (a folder), COCO, AlphaPose, MMPose or MediaPipe, or DeepLabCut's CSV.",
        )
    if first is None:
        raise InputError(f"{name} has no rows.")
    people, names = _columns(head, name)
    count = len(head["coords"])
    frames: dict[int, list[Detection]] = {}
    for number, line in (first, *lines):
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) != count + 1:
            raise InputError(f"{name}, line {number}: {len(cells)} cells where there are {count + 1} columns.")
        values = np.array(numbers_of(cells[1:], f"{name}, line {number}"))
        frames[len(frames)] = [
            Detection(sound_points(values[columns].reshape(-1, 3)), track) for track, columns in people.items()
        ]
    return Detections(frames, names)


def _columns(head: dict[str, list[str]], name: str) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """For each individual the columns of its points' x, y and likelihood; and the points' names."""
    parts, coords = head["bodyparts"], [each.lower() for each in head["coords"]]
    owners = head.get("individuals", [""] * len(parts))
    if not len(parts) == len(coords) == len(owners):
        raise InputError(f"{name}: its header lines have {len(parts)}, {len(coords)} and {len(owners)} columns.")
    found: dict[str, dict[str, dict[str, int]]] = {}
    for at, (owner, part, coordinate) in enumerate(zip(owners, parts, coords, strict=True)):
        if owner != "single":  # DeepLabCut's points that belong to no individual
            found.setdefault(owner, {}).setdefault(part, {})[coordinate] = at
    names = tuple(dict.fromkeys(parts))
    names = tuple(part for part in names if all(part in own for own in found.values()))
    if (
        not names
        or len(names) > MOST_POINTS
        or any({"x", "y"} - set(own[part]) for own in found.values() for part in names)
    ):
        raise InputError(f"{name}: its header names no points with x and y.")
    if any("likelihood" not in own[part] for own in found.values() for part in names):
        raise InputError(f"{name}: a point has no column of likelihood.", "Export it from DeepLabCut again.")
    return {
        owner: np.array([own[part][key] for part in names for key in ("x", "y", "likelihood")])
        for owner, own in found.items()
    }, names


def holds_keypoints(path: str) -> bool:
    """Whether a path is that of 2D keypoints; a folder or an archive is, of one file a frame.

    Raises: InputError if there is no such file.
    """
    if _holds_files(path):
        return True
    source = source_named(path)
    return looks_like_keypoints(source.read(), source.name)
