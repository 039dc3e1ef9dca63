"""Settings of `pumps export-mesh`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Write a mesh sequence for other programs, or a page that plays it."""

    input: Path = Field(description="The mesh artefact.")
    output: Path = Field(description="The .glb file (one clip stored as bones) or the .html page.")
    clip: tuple[str, ...] = Field(
        (), description="Clips to write; by default the first one for a GLB, four for a page."
    )
    beside: tuple[str, ...] = Field(
        (), description="NAME=MESHES: for a page, another artefact whose clips of the same names are played beside."
    )
    name: str = Field("meshes", description="For a page, the name of the artefact given.")
    start: int = Field(0, description="First frame to write.", ge=0)
    frames: int = Field(
        100, description="Frames of a clip on a page, at most; one of 13,700 vertices takes 110 KB.", ge=1
    )
