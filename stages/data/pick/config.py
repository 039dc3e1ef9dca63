"""Settings of `pumps data pick`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Copy test clips out of the sources, byte for byte."""

    motion: Path = Field(description="The motion artefact that says which clips there are, and where they came from.")
    output: Path = Field(description="Folder for the BVH files.")
    splits: tuple[str, ...] = Field(("test",), description="Which splits to pick from.")
    count: int = Field(3, description="How many clips, spread over archives and skeletons.", ge=1)
    longest_s: float = Field(20.0, description="Longest clip to pick, seconds, where there are shorter ones.", gt=0)
