"""Settings of `pumps evaluate`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig
from stages.shared.statistics.tasks import TASK_NAMES

PROTOCOLS = ("pumps", "lafan1")


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure filling on a `motion` artefact beside LERP and SLERP (task definitions in docs/evaluation.md)."""

    motion: Path = Field(description="The motion artefact whose test clips are filled.")
    output: Path = Field(description="Folder of the metrics artefact.")
    weights: tuple[str, ...] = Field(
        (), description="NAME=FOLDER or NAME of shipped weights; each is a method of the table."
    )
    tasks: tuple[str, ...] = Field(TASK_NAMES, description="Tasks to measure.")
    intervals: tuple[int, ...] = Field((5, 15, 30), description="Frames between keys in interpolation.")
    transitions: tuple[int, ...] = Field((15, 30, 60), description="Missing frames in transitions.")
    predictions: tuple[int, ...] = Field((15, 30), description="Last frames to predict.")
    window: int = Field(121, description="Frames in a window of interpolation and prediction.", ge=4)
    splits: tuple[str, ...] = Field(("test",), description="Which splits are measured.")
    unseen: bool = Field(
        False, description="All clips of the archives that none of the weights name as training data, and no others."
    )
    where: str | None = Field(None, description="Which clips of these: an expression of their index, 'not t_pose'.")
    max_windows: int = Field(
        0, description="Windows for each archive and task, spread evenly over its clips; 0 for all.", ge=0
    )
    breakdown: bool = Field(
        False, description="Also the solve on true clouds, and on clouds reconstructed with nothing masked."
    )
    foot_lock: bool = Field(True, description="Weights hold feet that stand, as `pumps infill` does.")
    protocol: str = Field("pumps", description="pumps, or lafan1 (that benchmark's own definitions).")
    points: int = Field(256, description="Points of the cloud.", ge=8)

    @field_validator("tasks")
    @classmethod
    def _tasks_exist(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [task for task in value if task not in TASK_NAMES]
        if unknown or not value:
            raise ValueError(f"must name some of {', '.join(TASK_NAMES)}, not {', '.join(unknown) or 'none'}")
        return value

    @field_validator("intervals", "transitions", "predictions")
    @classmethod
    def _frames_are_positive(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        if any(frames < 1 for frames in value):
            raise ValueError("must be frames, 1 or more")
        return value

    @field_validator("protocol")
    @classmethod
    def _protocol_exists(cls, value: str) -> str:
        if value not in PROTOCOLS:
            raise ValueError(f"must be one of {', '.join(PROTOCOLS)}")
        return value
