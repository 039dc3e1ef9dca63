"""Constraints from files: pumps' own JSON, Kimodo's JSON as far as it means the same, and a path as a CSV table.

Kimodo's file is a list of objects with `type` and `frame_indices`. Its `root2d` gives x and z of the root in metres,
Y up, which is a path of the pelvis; a heading beside it is not read. Its other types hold poses of Kimodo's own
skeletons, which no other rig has.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from data_schemas.errors import InputError
from stages.shared.formats.keypoint_json import parsed_json
from stages.shared.inference.constraints.asked import Constraints, RootPath

_MOST_BYTES = 64 << 20
_COLUMNS = {("frame", "x", "z"), ("frame", "x", "y", "z")}
_ROOT_2D = "root2d"


def read_constraints(path: Path) -> tuple[Constraints, list[str]]:
    """The constraints of a JSON file, and notes on what was not read.

    Raises: InputError naming the file and the field where it is none of the two layouts.
    """
    raw = parsed_json(_bytes_of(path), str(path))
    if isinstance(raw, list):
        return _of_kimodo(raw, path)
    if not isinstance(raw, dict):
        raise InputError(f"{path} holds no constraints.", "docs/formats.md shows the layout.")
    return _validated(raw, path), []


def constraints_of(raw: dict[str, Any]) -> Constraints:
    """The constraints of a dictionary in the layout of the JSON. Raises InputError naming the field."""
    return _validated(raw, "constraints")


def read_path(path: Path) -> RootPath:
    """The path of a CSV table with the columns frame, x, z, or frame, x, y, z: metres, Y up.

    Raises: InputError naming the file and line where it is no such table.
    """
    try:
        rows = list(csv.reader(io.StringIO(_bytes_of(path).decode("utf-8-sig", "replace"))))
    except csv.Error as error:  # such as a quote that never ends, before a very long rest
        raise InputError(f"{path} is not a table ({error}).", "Is the file damaged?") from None
    head = tuple(name.strip().lower() for name in rows[0]) if rows else ()
    if head not in _COLUMNS:
        raise InputError(
            f"{path} does not begin with the columns of a path.", "Its first line is frame,x,z or frame,x,y,z."
        )
    table = []
    for line, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        try:
            values = [float(cell) for cell in row]
        except ValueError:
            values = []
        if len(values) != len(head) or not np.isfinite(values).all() or values[0] != np.floor(values[0]):
            raise InputError(f"{path}, line {line} is not a frame and a place.", f"Give {len(head)} numbers.")
        table.append(values)
    if not table:
        raise InputError(f"{path} holds no place.", "Give one line for each frame.")
    path_rows = {"frames": [int(row[0]) for row in table], "places": [row[1:] for row in table]}
    return path_of(path_rows, path)


def path_of(raw: dict[str, Any], what: Path | str) -> RootPath:
    """A path from its frames and places. Raises InputError where they do not belong together."""
    try:
        return RootPath.model_validate(raw)
    except ValidationError as error:
        raise _sentence(error, what) from None


def _of_kimodo(raw: list[Any], path: Path) -> tuple[Constraints, list[str]]:
    frames: list[int] = []
    places: list[list[float]] = []
    turned = False
    for number, each in enumerate(raw):
        kind = each.get("type") if isinstance(each, dict) else None
        if kind != _ROOT_2D:
            raise InputError(
                f"{path}: constraint {number} is of type {kind!r}, which holds poses of Kimodo's skeletons.",
                "Of Kimodo's types, pumps reads root2d. Write poses as rows of the BVH, and hands and feet as pins.",
            )
        try:
            frames += each["frame_indices"]
            places += each["smooth_root_2d"]
        except (KeyError, TypeError):
            raise InputError(
                f"{path}: constraint {number} has no frame_indices and smooth_root_2d.", "Save it again from Kimodo."
            ) from None
        turned |= "global_root_heading" in each
    try:
        order = np.argsort(np.array(frames, np.int64), kind="stable").tolist()
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{path}: frame_indices are not frame numbers.", "Save it again from Kimodo.") from None
    if len(places) != len(frames):
        raise InputError(f"{path}: {len(frames)} frame_indices have {len(places)} places.", "Save it again.")
    found = {"frames": [frames[place] for place in order], "places": [places[place] for place in order]}
    notes = [f"{path} gives headings of the body, which are not read: keys decide where it faces."] if turned else []
    return Constraints(path=path_of(found, path)), notes


def _validated(raw: dict[str, Any], what: Path | str) -> Constraints:
    try:
        return Constraints.model_validate(raw)
    except ValidationError as error:
        raise _sentence(error, what) from None


def _sentence(error: ValidationError, what: Path | str) -> InputError:
    first = error.errors()[0]
    field = ".".join(str(part) for part in first["loc"])
    more = f" and {error.error_count() - 1} more" if error.error_count() > 1 else ""
    reason = str(first["msg"]).removeprefix("Value error, ").rstrip(".")
    return InputError(
        f"{what}: {field + ': ' if field else ''}{reason[:1].lower() + reason[1:]}{more}.",
        "docs/formats.md shows the layout.",
    )


def _bytes_of(path: Path) -> bytes:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path} is larger than constraints can be.", "Is it the right file?")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.", "Check the name.") from None
