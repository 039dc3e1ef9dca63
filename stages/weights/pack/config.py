"""Settings of `pumps weights pack`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Make a run's networks small enough to hand on."""

    run: Path = Field(description="The run's folder, with train-ae and train-lms, or packed weights.")
    output: Path = Field(description="Folder for the weights: its parts are ae and lms, and its card MODEL_CARD.md.")
    half: bool = Field(True, description="Keep the weights in half precision.")
    name: str = Field("", description="What the weights are called; the output folder's name by default.")
    measured: Path | None = Field(
        None,
        description="A metrics artefact of this very run (pumps evaluate): what they are good and bad at.",
    )
    method: str = Field("pumps", description="What the metrics artefact calls these weights.")
