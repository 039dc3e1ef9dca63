"""Settings of `pumps encode`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, ShardedConfig, WritingConfig


class Config(WritingConfig, ShardedConfig, DeviceConfig):
    """Encode every frame of a `tpc` artefact into a `latent` artefact."""

    tpc: Path = Field(description="The tpc artefact.")
    ae: Path = Field(description="The autoencoder's checkpoint artefact.")
    output: Path = Field(description="Folder of the latent artefact.")
    points: int = Field(0, description="How many of a rigid cloud's drawn points to encode; 0 for all.", ge=0)
    half: bool = Field(True, description="Store float16 instead of float32.")
