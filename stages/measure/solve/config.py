"""Settings of `pumps measure solve`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig

CONDITIONS = ("true", "groups", "scales", "noise", "points", "rigs", "keys")


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure how well skeletons follow clouds, true ones and worse ones, beside slerp between the keys."""

    motion: Path = Field(description="The motion artefact whose clips are used.")
    output: Path = Field(description="Folder of the metrics artefact.")
    intervals: tuple[int, ...] = Field((15, 30), description="Frames between keyframes, with true clouds.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    clips: int = Field(0, description="Clips per archive with true clouds, spread evenly; 0 for all.", ge=0)
    conditions: tuple[str, ...] = Field(
        CONDITIONS,
        description="Clouds to try: true; groups (body groups missing); scales (other sizes); noise; points "
        "(fewer or more); rigs (unusual skeletons); keys (a single keyframe).",
    )
    condition_clips: int = Field(6, description="Clips per archive for all conditions but true.", ge=1)
    condition_seconds: float = Field(10.0, description="Seconds to use from the middle of each of these clips.", gt=0)
    points: int = Field(256, description="Points per cloud.", ge=8)
    sigma_m: float = Field(
        0.05, description="Standard deviation of the points' offsets from the bones, in metres.", gt=0
    )
    networks: tuple[str, ...] = Field(
        (), description="NAME=FOLDER of `pumps train skeleton`; a row of the table for clips on its own rig."
    )

    made: Path | None = Field(
        None,
        description="Folder in which to keep some motions of the first condition, as ARCHIVE/METHOD, for `pumps "
        "report`.",
    )
    made_clips: int = Field(2, description="Clips per archive to keep in --made.", ge=1)

    @field_validator("conditions")
    @classmethod
    def _conditions_exist(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [name for name in value if name not in CONDITIONS]
        if unknown or not value:
            raise ValueError(f"must name some of {', '.join(CONDITIONS)}, not {', '.join(unknown) or 'none'}")
        return value

    @field_validator("intervals")
    @classmethod
    def _intervals_are_positive(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        if not value or any(frames < 1 for frames in value):
            raise ValueError("must be frames, 1 or more")
        return value
