"""Settings of `pumps data pick`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Copy test clips out of the sources, byte for byte."""

    motion: Path = Field(description="The motion artefact with the clips to choose from.")
    output: Path = Field(description="Folder for the BVH files and their list, clips.txt.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to choose from.")
    count: int = Field(3, description="How many clips, spread over archives and skeletons.", ge=1)
    longest_s: float = Field(20.0, description="Longest clip to choose, in seconds, if there are shorter ones.", gt=0)
