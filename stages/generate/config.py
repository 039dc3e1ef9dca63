"""Settings of `pumps generate`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Generate motions of actions with a trained generator."""

    weights: Path = Field(description="Checkpoint of `pumps train generator`.")
    output: Path = Field(description="Folder of the motion artefact.")
    action: tuple[str, ...] = Field((), description="Actions to generate; default: all that were learned.")
    count: int = Field(1, description="Motions of each action.", ge=1, le=100_000)
    frames: int | None = Field(
        None, description="Frames of each motion, at the rate of the training data; default: the usual length.",
        ge=2, le=20_000,
    )  # fmt: skip
