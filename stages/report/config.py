"""Settings of `pumps report`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.config import StageConfig


class Config(StageConfig):
    """One HTML page that opens offline: results, loss curves, motions side by side in 3D."""

    metrics: Path = Field(description="The metrics artefact.")
    checkpoints: tuple[Path, ...] = Field((), description="Checkpoint artefacts whose logs are drawn.")
    motions: tuple[str, ...] = Field((), description="NAME=PATH of BVH files or motion artefacts to play side by side.")
    keyframes: str = Field("every:15", description="Which frames of the motions were known.")
    output: Path = Field(description="The HTML file to write.")
