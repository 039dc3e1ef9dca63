"""Settings of `pumps export-mesh`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Write a mesh sequence for other programs, a page that plays it, or a picture of some of its frames."""

    input: Path = Field(description="The mesh artefact.")
    output: Path = Field(
        description="The .glb file (one clip stored as bones), the .html page or the .svg film strip."
    )
    clip: tuple[str, ...] = Field(
        (),
        description="Clips to write; by default the first that all artefacts hold, four for a page, else one.",
    )
    beside: tuple[str, ...] = Field(
        (),
        description="NAME=MESHES: for a page or a film strip, another artefact whose clips of the same names are "
        "shown beside; their first frames are shown together.",
    )
    name: str = Field("meshes", description="For a page or a film strip, the name of the artefact given.")
    start: int = Field(0, description="First frame to write.", ge=0)
    frames: int = Field(
        100,
        description="Frames of a clip on a page or a film strip, at most; on a page one of 13,700 vertices takes "
        "110 KB.",
        ge=1,
    )
    poses: int = Field(7, description="For a film strip, how many of these frames it shows, spread evenly.", ge=1)
