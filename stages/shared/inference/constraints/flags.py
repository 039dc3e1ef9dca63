"""Constraints from the texts of flags."""

from __future__ import annotations

from collections.abc import Sequence

from data_schemas.errors import UsageError
from stages.shared.inference.constraints.asked import Constraints, PartFrames, Pin, RootPath
from stages.shared.inference.constraints.frame_ranges import divided, name_and_frames

_KEYS = "--keyframes 0,40 or --keyframes arms=0,20,40 or --keyframes '0,40;arms=20'"


def constraints_of_flags(
    keyframes: str | None = None,
    keep: Sequence[str] = (),
    pins: Sequence[str] = (),
    path: RootPath | None = None,
    locks: Sequence[str] = (),
) -> Constraints:
    """The constraints that flags ask for.

    Args:
        keyframes: frames of the whole body and `PART=FRAMES`, joined by semicolons.
        keep, pins: texts such as `legs:all` and `right_hand:10-40`. locks: the same, or a part without frames.

    Raises: UsageError for a text of another form.
    """
    whole, parts = _keyframes(keyframes)
    return Constraints(
        keyframes=whole,
        parts=parts,
        keep=tuple(_part(*name_and_frames(text, "--keep", "legs:all or arms:10-40")) for text in keep),
        pins=tuple(_pin(*name_and_frames(text, "--pin", "right_hand:10-40")) for text in pins),
        path=path,
        locks=tuple(_part(*_locked(text)) for text in locks),
    )


def _keyframes(text: str | None) -> tuple[str | None, tuple[PartFrames, ...]]:
    if text is None or ("=" not in text and ";" not in text):
        return text, ()
    whole, parts = None, []
    for clause in (each.strip() for each in text.split(";")):
        name, equals, frames = (each.strip() for each in clause.rpartition("="))
        if equals and name and frames:
            parts.append(_part(name, frames))
        elif not equals and frames and whole is None:
            whole = frames
        else:
            raise UsageError(f"The keyframes {text!r} cannot be read.", f"Write for instance {_KEYS}.")
    return whole, tuple(parts)


def _locked(text: str) -> tuple[str, str]:
    found = divided(text)
    if found is None and not text.strip():
        raise UsageError("--lock names no part of the body.", "Write for instance neck or left_arm:10-40.")
    return found or (text.strip(), "all")


def _part(name: str, frames: str) -> PartFrames:
    return PartFrames(part=name, frames=frames)


def _pin(name: str, frames: str) -> Pin:
    return Pin(end=name, frames=frames)
