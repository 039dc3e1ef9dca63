"""Settings of `pumps measure ae`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure autoencoders on held-out clouds, and compare their order with PUMPS Table 2."""

    tpc: Path = Field(description="The tpc artefact whose clips are reconstructed.")
    weights: tuple[str, ...] = Field(
        description="NAME=FOLDER of the checkpoint of an autoencoder; each is a row of the table."
    )
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    max_windows: int = Field(60, description="Windows per archive, spread evenly over the clips; 0 for all.", ge=0)
    window: int = Field(0, description="Frames per window; 0 for as many as all autoencoders were trained on.", ge=0)
    points: int = Field(0, description="Points per cloud; 0 for as many as all autoencoders were trained on.", ge=0)
    sigma_m: float = Field(
        0.05, description="Standard deviation of the points' offsets from the bones, in metres.", gt=0
    )
    pictures: int = Field(2, description="Windows to draw, each with all rows.", ge=0)
