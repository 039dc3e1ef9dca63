"""What every stage's Config and Report share. Imports no torch, so that flags and help are made without it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class StageConfig(BaseModel):
    """Base of the stages' configs: frozen, typed, unknown keys refused. A field's description is its help text."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(0, description="Seed of every random draw of this stage.")


class DeviceConfig(StageConfig):
    """A stage that runs a network."""

    device: str = Field("auto", description="Where to compute: auto, cpu, cuda or mps.")


class StageReport(BaseModel):
    """What a stage tells when it is done: plain data, printed by the command line or dumped as JSON."""

    output: Path | None = None
    lines: list[str] = Field(default_factory=list, description="What a person should read, one sentence or row each.")
    figures: dict[str, Any] = Field(default_factory=dict, description="Counts and numbers for machines.")
    tints: dict[int, str] = Field(
        default_factory=dict, exclude=True, description="Line -> what it is about; a terminal may colour it so."
    )
