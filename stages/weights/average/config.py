"""Settings of `pumps weights average`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Average the weights of several trainings that started from the same weights (Wortsman et al. 2022)."""

    checkpoints: tuple[Path, ...] = Field(
        description="Checkpoint artefacts of one network, such as several trainings with `pumps train lms "
        "--initial` and different seeds.",
        min_length=2,
    )
    output: Path = Field(description="Folder of the checkpoint artefact.")
