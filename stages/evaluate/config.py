"""Settings of `pumps evaluate`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig, WritingConfig
from stages.shared.statistics.tasks import TASK_NAMES

PROTOCOLS = ("pumps", "lafan1")


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure filling on a `motion` artefact beside LERP and SLERP (task definitions in docs/evaluation.md)."""

    motion: Path = Field(description="The motion artefact whose clips are filled.")
    output: Path = Field(description="Folder of the metrics artefact.")
    weights: tuple[str, ...] = Field(
        (),
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights to measure: a name (`pumps weights list`), or NAME=FOLDER, which may also be a "
        "checkpoint of `pumps train baseline`, `train citl` or `train concepts`; each is a method in the tables.",
    )
    refine: Path | None = Field(
        None,
        description="A checkpoint of `pumps train concepts`: what each of the weights fills is also refined with it, "
        "between the keyframes, as NAME-refined. The clips' names must say their actions.",
    )
    tasks: tuple[str, ...] = Field(TASK_NAMES, description="Tasks to measure.")
    intervals: tuple[int, ...] = Field((5, 15, 30), description="Frames between keyframes, for interpolation.")
    transitions: tuple[int, ...] = Field((15, 30, 60), description="Missing frames, for transitions.")
    predictions: tuple[int, ...] = Field((15, 30), description="Missing frames at the end, for prediction.")
    window: int = Field(121, description="Frames per window, for interpolation and prediction.", ge=4)
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    unseen: bool = Field(
        False, description="Measure all clips of archives that none of the weights were trained on, and no others."
    )
    where: str | None = Field(
        None, description="Which of these clips to measure: an expression over the clip index, such as 'not t_pose'."
    )
    max_windows: int = Field(
        0, description="Windows per archive and task, spread evenly over the clips; 0 for all.", ge=0
    )
    category: tuple[str, ...] = Field(
        (), description="NAME=PATTERN: tables by categories of clips whose source matches, instead of by archives."
    )
    plain: bool = Field(True, description="Also measure the plain interpolations.")
    breakdown: bool = Field(
        False, description="Also measure the solver on true clouds, and on clouds reconstructed with nothing missing."
    )
    foot_lock: bool = Field(True, description="Keep planted feet in place, as `pumps infill` does.")
    protocol: str = Field(
        "pumps", description="Definitions of the measures: pumps, or lafan1 (those of that benchmark)."
    )
    keep_fills: bool = Field(
        False,
        description="Keep the filled windows of every method in the artefact, for the figures of `pumps report`.",
    )
    points: int = Field(256, description="Points per cloud.", ge=8)

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
