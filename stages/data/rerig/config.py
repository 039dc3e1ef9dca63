"""Settings of `pumps data rerig`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import SeededConfig, WritingConfig


class Config(WritingConfig, SeededConfig):
    """Put clips of a motion artefact on the rigs of another: bones turn as answering bones turn."""

    motion: Path = Field(description="The motion artefact with the clips.")
    rigs: Path = Field(description="The motion artefact with the rigs; its clips provide their reference poses.")
    output: Path = Field(description="Folder of the motion artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Splits whose clips are used.")
    where: str | None = Field(
        None, description="Which of these clips to use: an expression over the clip index, such as 'not t_pose'."
    )
    longest: int = Field(
        1800, description="Most frames of a clip, from a random start in a longer one; 0 for whole clips.", ge=0
    )
