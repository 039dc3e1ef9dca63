"""What the user limits cleaning to, and what a mask file says is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Skeleton
from stages.shared.inference.keyframes import parse_keyframes

ROOT = "root"  # the name of the position in --joints
_MOST_BYTES = 256 << 20


def chosen_frames(text: str | None, frames: int) -> np.ndarray:
    """(T,) True for frames to clean. Raises UsageError or InputError as `parse_keyframes`."""
    chosen = np.zeros(frames, bool)
    chosen[slice(None) if text is None else parse_keyframes(text, frames)] = True
    return chosen


def chosen_joints(text: str | None, skeleton: Skeleton) -> tuple[np.ndarray, bool]:
    """(J,) True for joints to clean, and whether positions are cleaned. Raises InputError for an unknown joint."""
    if text is None:
        return np.ones(skeleton.joints, bool), True
    wanted = [part.strip() for part in text.split(",") if part.strip()]
    hint = f"Its joints are {', '.join(skeleton.names[:12])}, ..."
    if not wanted:
        raise InputError("--joints names no joint.", hint)
    unknown = [name for name in wanted if name not in skeleton.names and name != ROOT]
    if unknown:
        raise InputError(f"The skeleton has no joint {unknown[0]!r}.", hint)
    return np.isin(np.array(skeleton.names), wanted), ROOT in wanted


def masked(path: Path | None, frames: int, names: tuple[str, ...]) -> np.ndarray:
    """(T, J) True for what a mask file says is missing.

    Raises: InputError if the file is not a table of 0 and 1 with a row for each frame, or names unknown joints.
    """
    missing = np.zeros((frames, len(names)), bool)
    if path is None:
        return missing
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path} is too large for a mask.")
        lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read ({error}).", "Give a CSV of 0 and 1.") from None
    cells = [[cell.strip() for cell in line.split(",")] for line in lines]
    head = cells.pop(0) if cells and not set(cells[0]) <= {"0", "1"} else None
    if len(cells) != frames:
        raise InputError(
            f"{path} has {len(cells)} rows, but the motion has {frames} frames.", "Give one row a frame."
        )
    width = len(head) if head is not None else 1
    for number, row in enumerate(cells):
        if len(row) != width or not set(row) <= {"0", "1"}:
            raise InputError(
                f"{path}: the row of frame {number} is not {width} values of 0 or 1.",
                "Name the joints in a header line, or give one column.",
            )
    table = np.array([[cell == "1" for cell in row] for row in cells], bool).reshape(frames, width)
    if head is None:
        return missing | table[:, :1]
    unknown = [name for name in head if name not in names]
    if unknown:
        raise InputError(f"{path} names the joint {unknown[0]!r}, which the skeleton does not have.", "Correct it.")
    for column, name in enumerate(head):
        missing[:, names.index(name)] |= table[:, column]
    return missing


def check_something_there(missing: np.ndarray, name: str) -> None:
    """Raise InputError if every frame is missing as a whole."""
    if missing.all(axis=1).all():
        raise InputError(
            f"{name} has no frame that is there: all are missing.", "Check the mask and the file's rows."
        )
