"""Settings of `pumps measure spectral`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure predictions of mesh sequences on held-out clips: SpecTrHuMS' Tables 1 to 4."""

    mesh: Path = Field(description="The mesh artefact with the clips.")
    weights: tuple[str, ...] = Field(
        (),
        description="NAME=FOLDER of a checkpoint of `pumps train spectral --task predict`; each is a row.",
    )
    last: tuple[str, ...] = Field(
        (),
        description="NAME=FOLDER of a checkpoint trained with --keep both, whose last weights are a row.",
    )
    pumps: str | None = Field(
        None,
        description="Weights of `pumps infill`, which predict the skeleton, skinned afterwards; none by default.",
    )
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    known: int = Field(50, description="First frames of a window that are known.", ge=2)
    ahead: int = Field(25, description="Frames to predict.", ge=1)
    stride: int = Field(5, description="Frames between the starts of neighbouring windows.", ge=1)
    max_windows: int = Field(0, description="Windows to measure, spread evenly; 0 for all.", ge=0)
