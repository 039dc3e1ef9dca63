"""Settings of `pumps complete-mesh`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import OFTEN, DeviceConfig, WritingConfig


class Config(WritingConfig, DeviceConfig):
    """Complete mesh sequences between their known frames and one known last frame."""

    mesh: Path = Field(description="The mesh artefact whose clips have frames to complete.")
    weights: Path = Field(description="Checkpoint of `pumps train spectral --task complete`.")
    output: Path = Field(description="Folder of the mesh artefact: one window of each clip, completed.")
    start: int = Field(
        0,
        json_schema_extra=OFTEN,
        description="First frame of the window; its first frames and its last one are known, and no others are read.",
        ge=0,
    )
    where: str | None = Field(None, description="Which clips to use: an expression over the clip index.")
