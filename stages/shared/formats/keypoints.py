"""2D keypoints of one person over time, as a detector wrote them, from any of the files that pumps reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.keypoint_layouts import (
    COUNTED,
    LAYOUTS,
    NAMED,
    layout_of_count,
    names_of_layout,
    standard_names,
)

MOST_POINTS = 256  # of one person
MOST_PEOPLE = 200  # in one frame
_MOST_GAP = 20  # frames without a detection, for each frame with one
_NEAR = 0.6  # of a person's size: a detection farther than this from the last one is of another person
_LEAST_POINTS = 6  # that a frame must have to count
_FARTHEST_PX = 1e7


@dataclass(frozen=True)
class Detection:
    """One person in one frame.

    points: (K, 3) x, y and confidence 0 to 1; x and y are NaN where the point is missing.
    track:  the person's number, if the detector follows people; "" if not.
    """

    points: np.ndarray
    track: str = ""


@dataclass(frozen=True)
class Detections:
    """The content of a file of keypoints, before a person is chosen.

    frames: frame number -> the people in it. names: of the K points, or empty.
    size:   width and height of the image in pixels, if stated. shares: True if x and y are shares of that size.
    fps:    frames a second, if stated.
    """

    frames: Mapping[int, Sequence[Detection]]
    names: tuple[str, ...] = ()
    size: tuple[float, float] | None = None
    shares: bool = False
    fps: float | None = None


@dataclass(frozen=True)
class Keypoints:
    """One person's keypoints.

    names: of K points, as `stages.shared.formats.keypoint_layouts` spells them. layout: their layout, or "named".
    places: (T, K, 2) pixels, x to the right and y down; NaN where missing.
    confidences: (T, K) 0 to 1, 0 where missing.
    size: width and height of the image in pixels, None if unknown. fps: None if unknown.
    people: how many people the file follows. missing: frames without this person.
    """

    names: tuple[str, ...]
    layout: str
    places: np.ndarray
    confidences: np.ndarray
    size: tuple[float, float] | None
    fps: float | None
    people: int = 1
    missing: int = 0


def detection_of(numbers: Iterable[float], where: str) -> np.ndarray:
    """(K, 3) points of a flat list of x, y and confidence. Raises InputError."""
    try:
        flat = np.fromiter(numbers, float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: a person's keypoints are not numbers.") from None
    if not 0 < flat.size <= 3 * MOST_POINTS or flat.size % 3:
        raise InputError(f"{where}: a person has {flat.size} numbers, which are not keypoints of 3 numbers each.")
    return sound_points(flat.reshape(-1, 3))


def sound_points(points: np.ndarray) -> np.ndarray:
    """(K, 3) keypoints: points that are missing, not finite or of no confidence are NaN with confidence 0.

    Detectors write a missing point as 0, 0.
    """
    out = np.array(points, float)
    gone = ~np.isfinite(out).all(axis=1) | (np.abs(out[:, :2]) > _FARTHEST_PX).any(axis=1)
    gone |= (out[:, :2] == 0).all(axis=1) | (out[:, 2] <= 0)
    out[gone] = (np.nan, np.nan, 0.0)
    out[:, 2] = np.minimum(out[:, 2], 1.0)
    return out


def person_of(
    found: Detections,
    name: str,
    *,
    person: int = 0,
    layout: str | None = None,
    size: tuple[float, float] | None = None,
) -> Keypoints:
    """The keypoints of one person.

    Args:
        person: 0 for the one who is seen most and largest, 1 for the next, and so on.
        layout: the layout, if it is not the one that the file or the number of points states.
        size: width and height of the image, if the file does not state them.

    Raises: InputError naming the file: no known layout, no such person, no frame with enough points, or coordinates
        that are shares of an image whose size is unknown.
    """
    tracks = people_of(found)
    if not tracks and any(found.frames.values()):
        raise InputError(
            f"{name}: nobody in it has two keypoints that are seen and apart.",
            "Detect again, or lower the detector's least confidence.",
        )
    if not tracks:
        raise InputError(f"{name} holds no person.", "Is it the output of a pose detector?")
    if not 0 <= person < len(tracks):
        raise InputError(
            f"{name} holds {len(tracks)} people, and --person {person} is none of them.", "They count from 0."
        )
    rows = tracks[person]
    count = len(next(iter(rows.values())))
    if layout is None and not found.names:
        layout = layout_of_count(count, name)
    names = names_of_layout(layout) if layout is not None else standard_names(found.names, name)
    if len(names) != count:
        raise InputError(
            f"{name} has {count} keypoints a person, and the layout {layout} has {len(names)}.",
            f"Known are {COUNTED}.",
        )
    layout = layout or next((each for each, own in LAYOUTS.items() if own == names), NAMED)
    size = size or found.size
    if found.shares and size is None:
        raise InputError(
            f"{name} states places as shares of the image, and not the image's size.", "Give --image-size 1920x1080."
        )
    places, confidences = _over_time(rows, sorted(found.frames), count, name)
    if found.shares and size is not None:
        places = places * np.array(size)
    enough = (confidences > 0).sum(axis=1) >= min(_LEAST_POINTS, count)
    if not enough.any():
        raise InputError(
            f"{name}: no frame has {_LEAST_POINTS} keypoints of this person.",
            "Choose another --person, or detect again.",
        )
    return Keypoints(names, layout, places, confidences, size, found.fps, len(tracks), int((~enough).sum()))


def people_of(found: Detections) -> list[dict[int, np.ndarray]]:
    """Each person as frame -> points (K, 3), those who are seen most and largest first.

    People whom the detector follows keep its numbers. Others are followed here: a detection goes on from the nearest
    person of the last frames, if it is near in units of its size. The time is linear in the number of frames.
    """
    tracks: dict[str, dict[int, np.ndarray]] = {}
    weights: dict[str, float] = {}
    last: dict[str, tuple[np.ndarray, float, int]] = {}  # middle, size, frame
    for frame in sorted(found.frames):
        taken: set[str] = set()
        for each in found.frames[frame][:MOST_PEOPLE]:
            middle, size = _middle_and_size(each.points)
            key = f"given {each.track}" if each.track else _nearest(last, taken, middle, size, frame)
            if key in taken or size == 0:
                continue
            key = key or f"own {len(tracks)}"
            taken.add(key)
            tracks.setdefault(key, {})[frame] = each.points
            weights[key] = weights.get(key, 0.0) + float(np.nansum(each.points[:, 2])) * size
            last[key] = middle, size, frame
            if len(last) > MOST_PEOPLE:
                del last[min(last, key=lambda one: last[one][2])]
    return [tracks[key] for key in sorted(tracks, key=lambda one: -weights[one])]


def _nearest(
    last: Mapping[str, tuple[np.ndarray, float, int]], taken: set[str], middle: np.ndarray, size: float, frame: int
) -> str:
    best, distance = "", _NEAR
    for key, (place, before, seen) in last.items():
        apart = float(np.linalg.norm(place - middle)) / max(size, before, 1e-9) / (1 + 0.2 * (frame - seen - 1))
        if key not in taken and apart < distance:
            best, distance = key, apart
    return best


def _middle_and_size(points: np.ndarray) -> tuple[np.ndarray, float]:
    there = points[points[:, 2] > 0, :2]
    if len(there) < 2:
        return np.zeros(2), 0.0
    return np.median(there, axis=0), float(np.linalg.norm(np.ptp(there, axis=0)))


def _over_time(
    rows: Mapping[int, np.ndarray], numbers: Sequence[int], count: int, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, K, 2) and confidences (T, K) of all frames from the file's first to its last."""
    frames = numbers[-1] - numbers[0] + 1
    if frames > 1000 + (_MOST_GAP + 1) * len(numbers):
        raise InputError(
            f"{name} counts its {len(numbers)} frames from {numbers[0]} to {numbers[-1]}, so nearly all are missing.",
            "Number them one after another.",
        )
    out = np.full((frames, count, 3), np.nan)
    out[..., 2] = 0.0
    for number, points in rows.items():
        if len(points) != count:
            raise InputError(f"{name}, frame {number}: a person has {len(points)} keypoints, and before {count}.")
        out[number - numbers[0]] = points
    return out[..., :2], out[..., 2]
