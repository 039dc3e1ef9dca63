"""Settings of `pumps measure concepts`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure generated and refined motions by the features of an action recogniser: FID, A-FID, accuracy, diversity
    and multimodality."""

    concepts: Path = Field(description="Concepts artefact of real motions, of the recogniser's rig and rate.")
    recogniser: Path = Field(description="Checkpoint of `pumps train recogniser`.")
    made: tuple[str, ...] = Field(
        (),
        description="NAME=FOLDER of motion artefacts to measure, with actions in their clips' sources. A row named "
        "'NAME + ...' is compared with the row NAME.",
    )
    fits: tuple[str, ...] = Field(
        (), description="NAME=FOLDER of concepts artefacts, whose splines' distance from the motion is measured."
    )
    splits: tuple[str, ...] = Field(
        ("test",), description="Splits of the real motions that the others are compared with."
    )
    actions: str = Field(
        "auto", description="Regular expression with a group that is the action in the source of a clip of --made."
    )
    repetitions: int = Field(20, description="Repetitions of each measure; the paper has 20.", ge=2)
    output: Path = Field(description="Folder of the metrics artefact.")
