"""Settings of `pumps decode`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.config import DeviceConfig


class Config(DeviceConfig):
    """Decode a `latent` artefact into clouds (tpc, dense), and onto skeletons where keyframes are known (motion)."""

    latent: Path = Field(description="The latent artefact.")
    ae: Path = Field(description="The autoencoder's checkpoint artefact.")
    motion: Path | None = Field(
        None, description="Motion artefact whose keyframes anchor skeletons; none: clouds only."
    )
    keyframes: str = Field("every:15", description="Which frames of the motion, at 30 fps, are known.")
    splits: tuple[str, ...] = Field(("test",), description="Which splits to decode.")
    points: int = Field(256, description="Points of the cloud.")
    output: Path = Field(description="Folder of the artefact: tpc without --motion, motion with it.")
