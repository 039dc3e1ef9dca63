"""Settings of `pumps measure ae`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure autoencoders on held-out clouds, and compare their order with PUMPS Table 2."""

    tpc: Path = Field(description="The tpc artefact whose held-out clips are reconstructed.")
    weights: tuple[str, ...] = Field(description="NAME=FOLDER of an autoencoder's checkpoint; each is a row.")
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Which splits are measured.")
    max_windows: int = Field(
        60, description="Windows for each archive, spread evenly over its clips; 0 for all.", ge=0
    )
    window: int = Field(0, description="Frames in a window; 0 for as many as all were trained on.", ge=0)
    points: int = Field(0, description="Points of a cloud; 0 for as many as all were trained on.", ge=0)
    sigma_m: float = Field(0.05, description="Standard deviation of the points' offsets, metres.", gt=0)
    pictures: int = Field(2, description="Windows that are drawn, each with all rows.", ge=0)
