"""Constraints finer than a frame, as a user asks for them: plain data, the same from flags, files and Python.

Parts of the body are named as `stages.shared.inference.constraints.rig_parts` lists them, frames as
`frame_ranges` reads them. Nothing here depends on a rig or on the length of a clip.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, FiniteFloat, model_validator

from data_schemas.errors import UsageError
from stages.shared.contract import StageConfig

Place = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
GroundPlace = tuple[FiniteFloat, FiniteFloat]
Name = Annotated[str, Field(min_length=1)]


class PartFrames(StageConfig):
    """Parts of the body, names joined by commas, in some frames."""

    part: Name = Field(description="Parts of the body, or joints, joined by commas.")
    frames: Name = Field(default="all", description="all, numbers, ranges such as 10-40, slices such as 10:41.")


class Pin(StageConfig):
    """An end effector that stays at a place in the world, or at one place for each frame."""

    end: Name = Field(description="left_hand, right_hand, left_foot, right_foot, head, or a joint.")
    frames: Name = Field(description="Frames, as of parts.")
    place: Place | None = Field(default=None, description="x, y, z in metres; by default where the end is.")
    places: tuple[Place, ...] | None = Field(default=None, description="One place for each frame instead.")

    @model_validator(mode="after")
    def _one_of_both(self) -> Pin:
        if self.place is not None and self.places is not None:
            raise ValueError("place and places are both given")
        return self


class RootPath(StageConfig):
    """Where the pelvis is in some frames; in the frames between them it moves smoothly from one to the next."""

    frames: tuple[int, ...] = Field(description="Rising frame numbers of the output.", min_length=1)
    places: tuple[GroundPlace, ...] | tuple[Place, ...] = Field(
        description="x, z of each frame in metres, Y up; or x, y, z."
    )

    @model_validator(mode="after")
    def _as_many(self) -> RootPath:
        if len(self.places) != len(self.frames):
            raise ValueError(f"{len(self.frames)} frames have {len(self.places)} places")
        if any(after <= before for before, after in zip(self.frames, self.frames[1:], strict=False)):
            raise ValueError("frames must rise")
        return self


class Constraints(StageConfig):
    """All that a user asks to keep.

    keyframes: frames in which the whole body is given.
    parts:     frames in which parts are keyframes. If `keyframes` is missing, all other parts keep all their frames.
    keep:      frames in which parts keep what the file holds, beside their keyframes.
    pins:      end effectors that stay at their place. path: where the pelvis moves.
    locks:     parts that the models do not move: between keyframes their joints turn from one to the next.
    """

    version: Literal[1] = 1
    keyframes: str | None = None
    parts: tuple[PartFrames, ...] = ()
    keep: tuple[PartFrames, ...] = ()
    pins: tuple[Pin, ...] = ()
    path: RootPath | None = None
    locks: tuple[PartFrames, ...] = ()

    @property
    def by_part(self) -> bool:
        """Whether some frame may be given in part."""
        return bool(self.parts or self.keep)

    @property
    def any(self) -> bool:
        """Whether there is more than keyframes of the whole body."""
        return bool(self.by_part or self.pins or self.path or self.locks)

    def joined(self, other: Constraints) -> Constraints:
        """Both together. Raises UsageError if both name keyframes of the whole body, or a path."""
        if self.keyframes is not None and other.keyframes is not None:
            raise UsageError("Keyframes of the whole body are named twice.", "Name them in one place.")
        if self.path is not None and other.path is not None:
            raise UsageError("Two paths of the pelvis are given.", "Give one.")
        return Constraints(
            keyframes=self.keyframes if self.keyframes is not None else other.keyframes,
            parts=self.parts + other.parts,
            keep=self.keep + other.keep,
            pins=self.pins + other.pins,
            path=self.path or other.path,
            locks=self.locks + other.locks,
        )
