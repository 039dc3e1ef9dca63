"""Settings of `pumps measure solve`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig

CONDITIONS = ("true", "groups", "scales", "noise", "points", "rigs", "keys")


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure how well skeletons follow clouds, true ones and worse ones, beside slerp between the keys."""

    motion: Path = Field(description="The motion artefact whose held-out clips are followed.")
    output: Path = Field(description="Folder of the metrics artefact.")
    intervals: tuple[int, ...] = Field((15, 30), description="Frames between keys with true clouds.")
    splits: tuple[str, ...] = Field(("test",), description="Which splits are measured.")
    clips: int = Field(0, description="Clips of each archive with true clouds, spread evenly; 0 for all.", ge=0)
    conditions: tuple[str, ...] = Field(
        CONDITIONS,
        description="What is tried: true clouds, missing body groups, other scales, noise, fewer or more points, "
        "stranger rigs, a single key.",
    )
    condition_clips: int = Field(6, description="Clips of each archive with worse clouds.", ge=1)
    condition_seconds: float = Field(10.0, description="Seconds from the middle of each of these clips.", gt=0)
    points: int = Field(256, description="Points of a cloud.", ge=8)
    sigma_m: float = Field(0.05, description="Standard deviation of the points' offsets, metres.", gt=0)
    networks: tuple[str, ...] = Field(
        (), description="NAME=FOLDER of `pumps train skeleton`; a row wherever its rig is the clips' own."
    )

    made: Path | None = Field(
        None, description="Also keep some motions of the first condition there, ARCHIVE/METHOD, to be played."
    )
    made_clips: int = Field(2, description="Clips of each archive to keep.", ge=1)

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
