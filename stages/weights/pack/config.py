"""Settings of `pumps weights pack`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Make a run's networks small enough to hand on."""

    run: Path = Field(
        description="A run's folder, with train-ae and train-lms, packed weights, or the folder of a fine-tuned"
        " network."
    )
    output: Path = Field(description="Folder for the weights and their card.")
    half: bool = Field(True, description="Store the weights in half precision.")
    name: str = Field("", description="Name of the weights; by default that of the output folder.")
    measured: Path | None = Field(
        None,
        description="The metrics artefact of this run (`pumps evaluate`); the card then states what the weights are "
        "good and bad at.",
    )
    licence: tuple[str, ...] = Field(
        (), description="Licence of sources that stated none (`unknown`) when they were read, and are known now."
    )
    method: str = Field("pumps", description="Name of these weights in the metrics artefact.")
