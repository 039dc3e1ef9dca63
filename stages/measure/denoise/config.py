"""Settings of `pumps measure denoise`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure denoising on held-out clips with noise added: mending, plain filters, networks (PUMPS Table 4)."""

    motion: Path = Field(description="The motion artefact of the clips, on any rigs.")
    weights: tuple[str, ...] = Field(
        (), description="NAME=FOLDER of the checkpoint of a network for denoise or repair; it is measured on its rig."
    )
    noise: str = Field("paper", description="Preset of the noise: paper, capture, or clean for none.")
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    tuning_splits: tuple[str, ...] = Field(
        ("val",), description="Splits on which the plain filters' widths are chosen."
    )
    category: tuple[str, ...] = Field(
        (),
        description="NAME=PATTERN: clips whose source matches, such as Walk=*walk*; by default the first word of the "
        "file's name.",
    )
    window: int = Field(128, description="Frames per window, at 30 a second.", ge=8)
    max_windows: int = Field(0, description="Windows per category, spread evenly over the clips; 0 for all.", ge=0)
