"""Texts that name the frames of a constraint: those of `parse_keyframes`, `all`, and `10-40`, which includes 40."""

from __future__ import annotations

import re

import numpy as np

from data_schemas.errors import InputError, UsageError
from stages.shared.inference.keyframes import parse_keyframes

_RANGE = re.compile(r"([0-9]{1,9})-([0-9]{1,9})")
_FRAMES = re.compile(r"all|every:[0-9]{1,15}|[-+]?[0-9][-+0-9:]*|:[-+0-9][-+0-9:]*")
_MOST_COLONS = 20  # of a joint's name
_BETWEEN = re.compile(r"[,\s]+")


def parse_frames(text: str, frames: int, what: str) -> np.ndarray:
    """(K,) int64 sorted frame numbers.

    Args:
        text: as above. frames: the clip's number of frames. what: the constraint, for errors.

    Raises: UsageError for another form, InputError for frames that are not in the clip.
    """
    found = []
    for part in _BETWEEN.split(text.strip()):
        bounds = _RANGE.fullmatch(part)
        if part == "all":
            found.append(np.arange(frames))
        elif bounds is not None:
            first, last = int(bounds[1]), int(bounds[2])
            if first > last:
                raise UsageError(f"{what}: the range {part} ends before it begins.", "Write it as 10-40.")
            if last >= frames:
                raise InputError(
                    f"{what}: the range {part} goes beyond the clip, which has frames 0 to {frames - 1}.",
                    "Name frames of the clip.",
                )
            found.append(np.arange(first, last + 1))
        else:
            try:
                found.append(parse_keyframes(part, frames))
            except (InputError, UsageError) as error:
                raise type(error)(f"{what}: {error.message}", error.hint) from None
    return np.unique(np.concatenate(found)).astype(np.int64)


def name_and_frames(text: str, option: str, example: str) -> tuple[str, str]:
    """`legs:10-40` as name and frames. Raises UsageError for another form."""
    found = divided(text)
    if found is None:
        raise UsageError(
            f"{option} {text!r} is not a part of the body and its frames.", f"Write for instance {example}."
        )
    return found


def divided(text: str) -> tuple[str, str] | None:
    """A text such as `legs:10-40` at the first colon that frames follow; None without frames. A joint's name may
    itself hold colons (mixamorig:LeftArm)."""
    pieces = text.strip().split(":")
    if not pieces[0]:
        return None
    for count in range(1, min(len(pieces), _MOST_COLONS)):
        frames = ":".join(pieces[count:])
        if all(_FRAMES.fullmatch(each) for each in _BETWEEN.split(frames)):
            return ":".join(pieces[:count]), frames
    return None
