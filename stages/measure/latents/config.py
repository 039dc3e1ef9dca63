"""Settings of `pumps measure latents`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig
from stages.shared.weights.shipped import default_weights


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure how much latents move when what should not matter changes, and how well they are decoded then."""

    motion: Path = Field(description="The motion artefact whose held-out clips are encoded.")
    weights: str = Field(
        default_factory=default_weights,
        description="Shipped weights by name, a run's folder, or an autoencoder's checkpoint.",
    )
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Which splits are measured.")
    max_windows: int = Field(
        12, description="Windows for each archive, spread evenly over its clips; 0 for all.", ge=0
    )
    window: int = Field(64, description="Frames in a window, at 30 a second.", ge=8)
    points: int = Field(0, description="Points of a cloud; 0 for as many as the weights were trained on.", ge=0)
    sigma_m: float = Field(0.05, description="Standard deviation of the points' offsets, metres.", gt=0)
