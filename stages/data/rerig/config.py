"""Settings of `pumps data rerig`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import SeededConfig, WritingConfig


class Config(WritingConfig, SeededConfig):
    """Put clips of a motion artefact on the rigs of another: bones turn as answering bones turn."""

    motion: Path = Field(description="The motion artefact whose clips are put on other rigs.")
    rigs: Path = Field(description="The motion artefact whose skeletons are the rigs; its clips lend them poses.")
    output: Path = Field(description="Folder of the motion artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Clips of which splits.")
    where: str | None = Field(None, description="Which clips of these: an expression of their index, 'not t_pose'.")
