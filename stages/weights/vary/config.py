"""Settings of `pumps weights vary`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Learn how true motions vary around what weights fill, for `pumps infill --samples`, and keep it beside them."""

    weights: str = Field(description="A run's folder, or packed weights; variation.json is written there.")
    motion: tuple[Path, ...] = Field(
        description="The motion artefact whose clips are filled and compared with the true motion; all archives have "
        "the same weight.",
        min_length=1,
    )
    splits: tuple[str, ...] = Field(
        ("train", "val"), description="Splits to use, but never those on which results are reported."
    )
    max_windows: int = Field(12, description="Windows per archive and task, spread evenly over the clips.", ge=1)
    intervals: tuple[int, ...] = Field((10, 15, 30), description="Frames between keyframes, for interpolation.")
    transitions: tuple[int, ...] = Field((15, 30, 60), description="Missing frames, for transitions.")
    predictions: tuple[int, ...] = Field((15, 30), description="Missing frames at the end, for prediction.")
    window: int = Field(121, description="Frames per window, for interpolation and prediction.", ge=4)
    points: int = Field(256, description="Points per cloud.", ge=8)
