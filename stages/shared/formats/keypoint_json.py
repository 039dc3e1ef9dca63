"""2D keypoints in JSON: OpenPose, COCO, AlphaPose, MMPose (ViTPose), easy_ViTPose, MediaPipe.

Each kind is known by its content. Reading takes time and memory in proportion to the file.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.keypoints import (
    MOST_PEOPLE,
    MOST_POINTS,
    Detection,
    Detections,
    detection_of,
    sound_points,
)

MOST_JSON_BYTES = 256 << 20
_NUMBER = re.compile(r"\d{1,12}")
_MOST_NUMBER = 10**9
_LANDMARKS = ("pose_landmarks", "poseLandmarks", "landmarks", "keypoints", "pose")
WORLD_NAMES = ("pose_world_landmarks", "poseWorldLandmarks", "world_landmarks", "worldLandmarks")  # in 3D
_TRUST = ("visibility", "score", "confidence", "presence")


def read_json(data: bytes, name: str) -> Detections:
    """The people in a file of JSON. Raises InputError naming the file and the frame."""
    if len(data) > MOST_JSON_BYTES:
        raise InputError(
            f"{name} has {len(data) / 1e6:.0f} MB, which is too much for keypoints in JSON.", "Split it."
        )
    raw = parsed_json(data, name)
    for kind in (_of_openpose, _of_coco, _of_mmpose, _of_easy_vitpose, _of_results, _of_landmarks):
        found = kind(raw, name)
        if found is not None:
            if not found.frames:
                raise InputError(f"{name} holds no frame.", "Is it the output of a pose detector?")
            return found
    raise InputError(
        f"{name} is JSON of no known pose detector.",
        "Known are OpenPose, COCO, AlphaPose, MMPose, easy_ViTPose and MediaPipe; docs/formats.md shows their forms.",
    )


def parsed_json(data: bytes, name: str) -> Any:
    """The JSON of a file. Raises InputError naming the file."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        raise InputError(f"{name} is not JSON or is damaged.", "Is the file truncated?") from None


def number_in(text: object) -> int | None:
    """The last whole number in a frame's name, such as 12 of "000000000012_keypoints"; None without one."""
    found = _NUMBER.findall(str(text)[-300:])
    return int(found[-1]) if found and int(found[-1]) <= _MOST_NUMBER else None


def _whole(value: object) -> int | None:
    if isinstance(value, bool) or not isinstance(value, int | str):
        return None
    return number_in(value) if isinstance(value, str) else value if 0 <= value <= _MOST_NUMBER else None


def _of_openpose(raw: Any, name: str) -> Detections | None:
    if not isinstance(raw, dict) or not isinstance(raw.get("people"), list):
        return None
    number = number_in(name.rsplit("/", 1)[-1].replace("_keypoints", "")) or 0
    return Detections({number: openpose_people(raw, name)})


def openpose_people(raw: Mapping[str, Any], where: str) -> list[Detection]:
    """The people of one frame of OpenPose. Raises InputError."""
    found = []
    for person in raw["people"][:MOST_PEOPLE]:
        flat = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
        if not isinstance(flat, list):
            raise InputError(f"{where} holds a person without pose_keypoints_2d.", "Run OpenPose with --write_json.")
        if flat:
            found.append(Detection(detection_of(flat, where), _track(person.get("person_id"))))
    return found


def _track(value: object) -> str:
    """A person's number as text, "" for none."""
    if isinstance(value, list):
        value = value[0] if value else None
    if isinstance(value, bool) or not isinstance(value, int | float | str) or value in (-1, -1.0, "", "-1"):
        return ""
    return str(value)[:40]


def _of_coco(raw: Any, name: str) -> Detections | None:
    """COCO's annotations, which hold the images' sizes."""
    if not isinstance(raw, dict) or not isinstance(raw.get("annotations"), list):
        return None
    sizes: dict[Any, Any] = {}
    numbers: dict[Any, int] = {}
    listed = raw.get("images")
    images = [each for each in listed if isinstance(each, dict)] if isinstance(listed, list) else []
    for image in images:
        key = _key(image.get("id"))
        number = number_in(image.get("file_name", "")) if image.get("file_name") else None
        numbers[key] = number if number is not None else len(numbers)
        sizes[key] = image.get("width"), image.get("height")
    if len(set(numbers.values())) < len(numbers):  # names that end alike, as cam1.jpg of several folders
        numbers = {key: at for at, key in enumerate(numbers)}
    found = _of_rows(raw["annotations"], name, numbers)
    size = next(iter(sizes.values()), None)
    names = _category_names(raw)
    return Detections(found, names, _size_of(size))


def _category_names(raw: Mapping[str, Any]) -> tuple[str, ...]:
    categories = raw.get("categories")
    first = categories[0] if isinstance(categories, list) and categories else None
    names = first.get("keypoints") if isinstance(first, dict) else None
    return tuple(str(each)[:60] for each in names[:MOST_POINTS]) if isinstance(names, list) else ()


def _of_results(raw: Any, name: str) -> Detections | None:
    """COCO's results, and AlphaPose's: one person a row, with the image's number or name."""
    if not isinstance(raw, list) or not raw or not isinstance(raw[0], dict) or "image_id" not in raw[0]:
        return None
    numbered = [_whole(each.get("image_id")) if isinstance(each, dict) else None for each in raw]
    if any(number is None for number in numbered):
        order = dict.fromkeys(_key(each.get("image_id")) if isinstance(each, dict) else None for each in raw)
        return Detections(_of_rows(raw, name, {key: at for at, key in enumerate(order)}))
    return Detections(_of_rows(raw, name, None))


def _of_rows(rows: Sequence[Any], name: str, numbers: Mapping[Any, int] | None) -> dict[int, list[Detection]]:
    found: dict[int, list[Detection]] = {number: [] for number in (numbers or {}).values()}
    for at, row in enumerate(rows):
        where = f"{name}, row {at}"
        if not isinstance(row, dict) or not isinstance(row.get("keypoints"), list):
            raise InputError(f"{where}: there are no keypoints.", "Is it the output of a pose detector?")
        image = row.get("image_id")
        number = _whole(image) if numbers is None else numbers.get(_key(image))
        if number is None:
            raise InputError(f"{where}: its image_id is that of no image.")
        people = found.setdefault(number, [])
        if len(people) < MOST_PEOPLE and row["keypoints"]:
            points = detection_of(row["keypoints"], where)
            track = row.get("track_id", row.get("idx", row.get("person_id", -1)))
            people.append(Detection(points, _track(track)))
    return found


def _key(value: object) -> Any:
    return value if isinstance(value, int | str | float) else None


def _of_mmpose(raw: Any, name: str) -> Detections | None:
    """MMPose: `instance_info` of a video, or its list alone, or the instances of one image."""
    meta = raw.get("meta_info", {}) if isinstance(raw, dict) else {}
    frames = raw.get("instance_info") if isinstance(raw, dict) else raw
    if not isinstance(frames, list) or not frames or not isinstance(frames[0], dict):
        return None
    if "instances" not in frames[0]:
        if "keypoint_scores" not in frames[0]:
            return None
        frames = [{"frame_id": 0, "instances": frames}]
    found: dict[int, list[Detection]] = {}
    for at, frame in enumerate(frames):
        instances = frame.get("instances") if isinstance(frame, dict) else None
        if not isinstance(instances, list):
            raise InputError(f"{name}, entry {at}: there are no instances.")
        number = _whole(frame.get("frame_id", at))
        where = f"{name}, frame {at if number is None else number}"
        people = [_instance(each, where) for each in instances[:MOST_PEOPLE]]
        found[at if number is None else number] = people
    return Detections(
        found,
        _numbered_names(_field(meta, "keypoint_id2name")),
        _size_of(_field(meta, "image_size")),
        fps=_rate(meta),
    )


def _instance(instance: Any, where: str) -> Detection:
    points = instance.get("keypoints") if isinstance(instance, dict) else None
    if not isinstance(points, list):
        raise InputError(f"{where}: a person has no keypoints.")
    pairs = _table(points, 2, where)
    scores = instance.get("keypoint_scores", [1.0] * len(pairs))
    if not isinstance(scores, list) or len(scores) != len(pairs):
        raise InputError(f"{where}: a person has {len(pairs)} keypoints and not as many scores.")
    rows = [[*pair, score] for pair, score in zip(pairs, scores, strict=True)]
    return Detection(sound_points(np.array(_table(rows, 3, where))), _track(instance.get("track_id", -1)))


def _table(rows: list[Any], width: int, where: str) -> list[list[float]]:
    """Rows of `width` numbers; None stands for a missing number."""
    if not 0 < len(rows) <= MOST_POINTS:
        raise InputError(f"{where}: a person has {len(rows)} keypoints; pumps reads 1 to {MOST_POINTS}.")
    try:
        table = [[float("nan") if each is None else float(each) for each in row[:width]] for row in rows]
    except (TypeError, ValueError, KeyError, OverflowError):
        raise InputError(f"{where}: a person's keypoints are not numbers.") from None
    if any(len(row) < width for row in table):
        raise InputError(f"{where}: a person's keypoint has fewer than {width} numbers.")
    return table


def _numbered_names(names: Any) -> tuple[str, ...]:
    if isinstance(names, dict) and len(names) <= MOST_POINTS and all(str(at) in names for at in range(len(names))):
        return tuple(str(names[str(at)])[:60] for at in range(len(names)))
    return ()


def _field(meta: Any, key: str) -> Any:
    return meta.get(key) if isinstance(meta, dict) else None


def _rate(meta: Any) -> float | None:
    fps = _field(meta, "fps")
    return float(fps) if isinstance(fps, int | float) and 0.1 <= fps <= 10_000 else None


def _size_of(value: Any) -> tuple[float, float] | None:
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(each, int | float) for each in value):
        width, height = (float(each) for each in value)
        return (width, height) if 1 <= width <= 1e6 and 1 <= height <= 1e6 else None
    return None


def _of_easy_vitpose(raw: Any, name: str) -> Detections | None:
    """easy_ViTPose: for each frame, person -> rows of y, x and score."""
    frames = raw.get("keypoints") if isinstance(raw, dict) else None
    if not isinstance(frames, list) or not frames or not isinstance(frames[0], dict) or "skeleton" not in raw:
        return None
    found: dict[int, list[Detection]] = {}
    for number, people in enumerate(frames):
        if not isinstance(people, dict):
            raise InputError(f"{name}, frame {number}: it holds no people.")
        found[number] = []
        for track, rows in list(people.items())[:MOST_PEOPLE]:
            if not isinstance(rows, list):
                raise InputError(f"{name}, frame {number}: a person's keypoints are not numbers.")
            points = np.array(_table(rows, 3, f"{name}, frame {number}"))[:, [1, 0, 2]]
            found[number].append(Detection(sound_points(points), _track(track)))
    return Detections(found, _numbered_names(raw["skeleton"]))


def _of_landmarks(raw: Any, name: str) -> Detections | None:
    """MediaPipe: for each frame a list of mappings with x, y and visibility, which are shares of the image."""
    frames = raw.get("frames", raw.get("results")) if isinstance(raw, dict) else raw
    if isinstance(raw, dict) and frames is None:
        frames = [raw] if _points_in(raw) is not None else None
    if not isinstance(frames, list) or not frames:
        return None
    if _is_point(frames[0]):
        frames = [frames]
    if all(_points_in(frame) is None for frame in frames[:1000]):
        return None
    found: dict[int, list[Detection]] = {}
    largest = 0.0
    for number, frame in enumerate(frames):
        rows = _points_in(frame)
        found[number] = []
        if rows:
            points = np.array(_table([_row(each) for each in rows], 3, f"{name}, frame {number}"))
            detection = Detection(sound_points(points))
            seen = np.abs(detection.points[:, :2][detection.points[:, 2] > 0])
            largest = max(largest, float(seen.max(initial=0.0)))
            found[number].append(detection)
    meta = raw if isinstance(raw, dict) else {}
    size = _size_of(_field(meta, "image_size") or [_field(meta, "width"), _field(meta, "height")])
    return Detections(found, size=size, shares=largest < 4.0, fps=_rate(meta))  # a point may lie outside the image


def _is_point(value: Any) -> bool:
    return isinstance(value, dict) and "x" in value and "y" in value


def _points_in(frame: Any) -> list[Any] | None:
    """The landmarks of one frame: a list of them, one of several people's, or under one of MediaPipe's names."""
    if isinstance(frame, dict):
        frame = next((frame[key] for key in _LANDMARKS if isinstance(frame.get(key), list)), None)
    if isinstance(frame, list) and frame and isinstance(frame[0], list):
        frame = frame[0]
    if isinstance(frame, list) and (not frame or all(map(_is_point, frame[: MOST_POINTS + 1]))):
        return frame[: MOST_POINTS + 1]
    return None


def _row(point: Mapping[str, Any]) -> list[Any]:
    trust = next((point[key] for key in _TRUST if isinstance(point.get(key), int | float)), 1.0)
    return [point["x"], point["y"], trust]


def frames_of_files(files: Iterable[tuple[str, bytes]]) -> Detections:
    """One frame a file, as OpenPose writes them: numbered by the files' names, or in their order.

    Raises: InputError naming the file.
    """
    people: list[tuple[str, list[Detection]]] = []
    for name, data in files:
        if len(data) > MOST_JSON_BYTES // 16:
            raise InputError(f"{name} has {len(data) / 1e6:.0f} MB, which is too much for one frame.")
        raw = parsed_json(data, name)
        if not isinstance(raw, dict) or not isinstance(raw.get("people"), list):
            raise InputError(f"{name} is no frame of OpenPose, in a folder of such frames.", "Move it elsewhere.")
        people.append((name, openpose_people(raw, name)))
    numbers = [number_in(name.rsplit("/", 1)[-1].replace("_keypoints", "")) for name, _ in people]
    if None in numbers or len(set(numbers)) < len(numbers):
        numbers = list(range(len(people)))
    return Detections({number or 0: found for number, (_, found) in zip(numbers, people, strict=True)})
