"""Settings of `pumps measure task`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure networks for any task of `pumps train finetune` on held-out clips of their rig, by category."""

    tpc: Path = Field(description="The tpc artefact with clips of the networks' rig.")
    weights: tuple[str, ...] = Field(
        description="NAME=FOLDER of a checkpoint of `pumps train finetune`, all of one task; each is a row of the "
        "table. Several of one NAME, trained for different times, are a curve of error against minutes of training.",
        min_length=1,
    )
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    category: tuple[str, ...] = Field(
        (),
        description="NAME=PATTERN: clips whose source matches, such as Walk=*walk*; by default the first word of the "
        "file's name.",
    )
    window: int = Field(128, description="Frames per window, at 30 a second.", ge=8)
    max_windows: int = Field(0, description="Windows per category, spread evenly over the clips; 0 for all.", ge=0)
