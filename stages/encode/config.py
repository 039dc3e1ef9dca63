"""Settings of `pumps encode`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, ShardedConfig, WritingConfig


class Config(WritingConfig, ShardedConfig, DeviceConfig):
    """Encode every frame of a `tpc` artefact into a `latent` artefact."""

    tpc: Path = Field(description="The tpc artefact to encode.")
    ae: Path = Field(description="Checkpoint artefact of the autoencoder.")
    output: Path = Field(description="Folder of the latent artefact.")
    points: int = Field(0, description="Points per cloud to encode, of those drawn; 0 for all.", ge=0)
    half: bool = Field(True, description="Store float16 instead of float32.")
