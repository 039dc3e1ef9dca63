"""Settings of `pumps weights calibrate`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Learn how far weights may be trusted, on motions they were not trained on, and keep that beside them."""

    weights: str = Field(description="A run's folder, or packed weights; the confidence is written there.")
    motion: tuple[Path, ...] = Field(
        description="Motion artefacts whose clips are filled and compared with the truth; all archives in them weigh "
        "the same.",
        min_length=1,
    )
    splits: tuple[str, ...] = Field(("val",), description="Which splits; never those that figures are reported on.")
    max_windows: int = Field(12, description="Windows for each archive and task, spread evenly.", ge=1)
    intervals: tuple[int, ...] = Field((5, 10, 15, 30), description="Frames between keys.")
    transitions: tuple[int, ...] = Field((15, 30, 60), description="Missing frames in transitions.")
    predictions: tuple[int, ...] = Field((15,), description="Last frames to predict.")
    window: int = Field(121, description="Frames in a window of interpolation and prediction.", ge=4)
    points: int = Field(256, description="Points of the cloud.", ge=8)
    prior_windows: float = Field(
        4.0, description="Windows that a bin needs to be heard as much as the wider bin it lies in.", gt=0
    )
