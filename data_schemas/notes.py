"""Faults and assumptions that a reader reports of a recording: codes, and the sentences that are made from them.

Readers return a `Note`: a code and its figures. The tables `clips.parquet` and `sources.parquet` keep the codes in
the column `flags`, separated by spaces. A sentence is made for a person to read; no program reads it back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any


class Flag(str, Enum):
    """The codes. A code keeps its spelling, since old artefacts hold it."""

    FPS_OVERRIDE = "fps-override"  # the user gave the frame rate
    # Faults that were corrected.
    TRIMMED = "trimmed"
    FRAMES_LINE_OFF = "frames-line-off"
    ROWS_JOINED = "rows-joined"
    FRAMES_MISSING = "frames-missing"
    UNEVEN_FRAMES = "uneven-frames"
    ONE_FRAME_CLIPS = "one-frame-clips"
    SIDES_FROM_POSE = "sides-from-pose"
    UNIT_UNCERTAIN = "unit-uncertain"
    NO_TRANSLATION = "no-translation"
    BONES_STRETCH = "bones-stretch"
    PLACES_INTERPOLATED = "places-interpolated"
    COLUMNS_LEFT_OUT = "columns-left-out"
    ROTATIONS_LEFT_OUT = "rotations-left-out"
    OTHER_SKINS = "other-skins"
    NODES_AS_JOINTS = "nodes-as-joints"
    UPSIDE_DOWN = "upside-down"
    HANDS_LEFT_OUT = "hands-left-out"
    # Assumptions about facts that no file states. The reader of positions reports a missing rate as a fault.
    NO_FRAME_RATE = "no-frame-rate"
    NEUTRAL_BODY = "neutral-body"
    NO_GENDER = "no-gender"
    MEAN_BODY = "mean-body"
    UP_FROM_MOTION = "up-from-motion"


@dataclass(frozen=True)
class Note:
    """A code and the figures that its sentence names. Made by `note`."""

    flag: Flag
    figures: tuple[tuple[str, Any], ...] = ()

    def __str__(self) -> str:
        """The sentence."""
        return _SENTENCES[self.flag](**dict(self.figures))


def note(flag: Flag, **figures: Any) -> Note:
    """A note with its figures, which are those that the flag's sentence takes."""
    return Note(flag, tuple(sorted(figures.items())))


def sentences_of(notes: Iterable[Note]) -> list[str]:
    """The notes as a person reads them."""
    return [str(each) for each in notes]


def flags_text(flags: Iterable[Flag]) -> str:
    """The codes as a table keeps them: each once, in the order in which they came, separated by spaces."""
    return " ".join(dict.fromkeys(flag.value for flag in flags))


def _trimmed(frames: int, calibration: bool) -> str:
    why = ": a calibration pose and the motion that leads out of it" if calibration else ""
    return f"Dropped the first {f'{frames} frames' if frames > 1 else 'frame'}{why}."


def _unit_uncertain(unit_m: float, stature_m: float, scaled: bool) -> str:
    if scaled:
        return (
            f"The unit is uncertain: no common unit gives a human size, so {unit_m:.4g} m is used, which makes "
            f"legs and trunk {stature_m:.1f} m long."
        )
    return f"The unit is uncertain: {unit_m:.4g} m is assumed, which gives a stature of {stature_m:.2f} m."


_SENTENCES: dict[Flag, Callable[..., str]] = {
    Flag.FPS_OVERRIDE: lambda fps: f"The frame rate is {fps:g} frames a second, as given.",
    Flag.TRIMMED: _trimmed,
    Flag.FRAMES_LINE_OFF: lambda declared, found: (
        f"Frames says {declared} and there are {found} rows; the rows are used."
    ),
    Flag.ROWS_JOINED: lambda lines, rows: (
        f"Its {rows} rows stand on {lines} lines; they were put together by the number of channels."
    ),
    Flag.FRAMES_MISSING: lambda frame, following: (
        f"Frame {frame:g} is followed by {following:g}; frames seem to be missing."
    ),
    Flag.UNEVEN_FRAMES: lambda fps: (
        f"Its frames last unequally long; they were resampled to {fps:g} frames a second."
    ),
    Flag.ONE_FRAME_CLIPS: lambda clips: f"{clips} clips of one frame were left out.",
    Flag.SIDES_FROM_POSE: lambda clear: (
        "Joint names state no sides; left and right were found from the pose"
        f"{'' if clear else ', which leaves them uncertain'}."
    ),
    Flag.UNIT_UNCERTAIN: _unit_uncertain,
    Flag.NO_TRANSLATION: lambda: "It has no trans or transl; the pelvis stays where it is.",
    Flag.BONES_STRETCH: lambda: "Some bones slide or stretch; their translations and lengths were left out.",
    Flag.PLACES_INTERPOLATED: lambda places: f"{places} missing places of joints were interpolated linearly in time.",
    Flag.COLUMNS_LEFT_OUT: lambda where, left_out, without: (
        f"Columns for which {where} has no joint were left out: {left_out}"
        f"{f'; joints without a column: {without}' if without else ''}."
    ),
    Flag.ROTATIONS_LEFT_OUT: lambda columns: (
        f"{columns} columns of rotations or velocities were left out; only the places of joints are read."
    ),
    Flag.OTHER_SKINS: lambda joints: f"{joints} joints of other skins were left out.",
    Flag.NODES_AS_JOINTS: lambda: "It has no skin; its animated nodes are taken for joints.",
    Flag.UPSIDE_DOWN: lambda: "The robot is upside down; the quaternions seem to be w x y z where x y z w is read.",
    Flag.NO_FRAME_RATE: lambda fps: f"It states no frame rate; {fps:g} frames a second are assumed.",
    Flag.NEUTRAL_BODY: lambda: "Its joints are those of a neutral body: no --body-models were given.",
    Flag.NO_GENDER: lambda pickled: f"It states no gender{' (pickled)' if pickled else ''}; neutral is assumed.",
    Flag.HANDS_LEFT_OUT: lambda: (
        "Its hands are principal components, which only the body model can turn into rotations; they were left out."
    ),
    Flag.UP_FROM_MOTION: lambda up_axis, stands: (
        f"{up_axis.upper()} is up, since the body stands along it."
        if stands
        else f"{up_axis.upper()} is taken to be up; the body stands along no axis, and the file states none."
    ),
    Flag.MEAN_BODY: lambda: "It has no betas; the model's mean body is used.",
}
