"""Settings of `pumps predict-mesh`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import OFTEN, DeviceConfig, WritingConfig


class Config(WritingConfig, DeviceConfig):
    """Predict how mesh sequences go on."""

    mesh: Path = Field(description="The mesh artefact whose clips go on.")
    weights: Path = Field(description="Checkpoint of `pumps train spectral --task predict`.")
    kept: Literal["best", "last"] = Field("best", description="Which weights of a training with --keep both to use.")
    output: Path = Field(
        description="Folder of the mesh artefact: each clip's known frames, then the predicted ones."
    )
    frames: int = Field(
        25,
        json_schema_extra=OFTEN,
        description="Frames to predict; more than the weights predict at once are predicted in turns.",
        ge=1,
    )
    until: int | None = Field(
        None, description="Frames of a clip that are taken as known; by default all. Later ones are not read.", ge=1
    )
    where: str | None = Field(None, description="Which clips to use: an expression over the clip index.")
