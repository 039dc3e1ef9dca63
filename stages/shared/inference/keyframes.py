"""Texts that name the given frames: `0,15,40`, `every:15`, slices such as `40:` and `10:20`, and mixtures of them."""

from __future__ import annotations

import re

import numpy as np

from data_schemas.errors import InputError, UsageError

_NUMBER = re.compile(r"[+-]?[0-9]{1,15}")
_EVERY = re.compile(r"every:([0-9]{1,15})")
_SLICE = re.compile(r"([+-]?[0-9]{1,15})?:([+-]?[0-9]{1,15})?(?::([0-9]{1,15}))?")
_FORMS = "Write numbers and slices joined by commas, such as 0,15,40 or 0,10:20,40: or every:15."


def parse_keyframes(text: str, frames: int) -> np.ndarray:
    """Frame numbers that a text names, sorted, without repetition.

    Args:
        text: parts joined by commas or spaces. A number counts from 0, or from the end if it is negative. A slice
            `first:stop` or `first:stop:step` does not include `stop`. `every:n` is 0, n, 2n and so on, and the last
            frame.
        frames: the clip's number of frames.

    Returns: (K,) int64, K >= 1.
    Raises: UsageError if the text has another form, InputError if it names frames that do not exist.
    """
    parts = [part for part in re.split(r"[,\s]+", text.strip()) if part]
    if not parts:
        raise UsageError("No keyframes are named.", _FORMS)
    if frames <= 0:
        raise InputError("Keyframes need a clip that has frames.", "Check the clip's MOTION section.")
    return np.unique(np.concatenate([_frames_of(part, frames) for part in parts])).astype(np.int64)


def parse_transition(text: str, frames: int) -> np.ndarray:
    """Frames that are given if a text `first:stop` names the missing ones; (K,) int64, sorted.

    Raises: UsageError for another form, InputError if the gap is outside the clip or leaves no frame around it.
    """
    match = _SLICE.fullmatch(text.strip())
    if match is None or match[1] is None or match[2] is None or match[3] is not None:
        raise UsageError(
            f"The transition {text!r} is not a range of frames.", "Write it as first:stop, such as 30:60."
        )
    first, stop = int(match[1]), int(match[2])
    if not 0 < first < stop < frames:
        raise InputError(
            f"The transition {first}:{stop} needs known frames on both sides; the clip has frames 0 to {frames - 1}.",
            "Choose 0 < first < stop < frame count.",
        )
    return np.concatenate([np.arange(first), np.arange(stop, frames)])


def _frames_of(part: str, frames: int) -> np.ndarray:
    if _NUMBER.fullmatch(part):
        return np.array([_frame(int(part), part, frames)])
    every = _EVERY.fullmatch(part)
    if every is not None:
        step = int(every[1])
        if step < 1:
            raise UsageError(f"The keyframes {part!r} need a step of at least 1.", _FORMS)
        return np.append(np.arange(0, frames, min(step, frames)), frames - 1)
    pieces = _SLICE.fullmatch(part)
    if pieces is None:
        raise UsageError(f"The keyframes {part!r} cannot be read.", _FORMS)
    first = _frame(int(pieces[1]), part, frames) if pieces[1] else 0
    stop = _stop(int(pieces[2]), part, frames) if pieces[2] else frames
    step = int(pieces[3]) if pieces[3] else 1
    if step < 1:
        raise UsageError(f"The keyframes {part!r} need a step of at least 1.", _FORMS)
    chosen = np.arange(first, stop, min(step, frames))
    if len(chosen) == 0:
        raise InputError(f"The keyframes {part!r} name no frame of the clip's {frames}.", _FORMS)
    return chosen


def _frame(number: int, part: str, frames: int) -> int:
    if not -frames <= number < frames:
        raise InputError(
            f"The keyframes {part!r} go beyond the clip: it has frames 0 to {frames - 1}.",
            "Frames count from 0; negative numbers count from the end.",
        )
    return number % frames


def _stop(number: int, part: str, frames: int) -> int:
    """One past a slice's last frame; a number beyond the clip's end is an error."""
    return _frame(number - 1, part, frames) + 1 if number > 0 else _frame(number, part, frames)
