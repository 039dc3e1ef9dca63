"""Settings of `pumps measure latents`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig, WritingConfig
from stages.shared.weights.shipped import default_weights


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure how much latents move when what should not matter changes, and how well they are decoded then."""

    motion: Path = Field(description="The motion artefact whose clips are encoded.")
    weights: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights that come with pumps, by name; a run's folder; or the checkpoint of an autoencoder.",
    )
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    max_windows: int = Field(12, description="Windows per archive, spread evenly over the clips; 0 for all.", ge=0)
    window: int = Field(64, description="Frames per window, at 30 per second.", ge=8)
    points: int = Field(0, description="Points per cloud; 0 for as many as the weights were trained on.", ge=0)
    sigma_m: float = Field(
        0.05, description="Standard deviation of the points' offsets from the bones, in metres.", gt=0
    )
