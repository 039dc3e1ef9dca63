"""Settings of `pumps body-parts compose`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Put a body together from trained parts, some of them more than once."""

    recipe: Path = Field(description="The TOML file that names the parts and their motions.")
    output: Path = Field(description="The file to write; its suffix names the format.")
    picture: Path | None = Field(None, description="An SVG of a few frames to write too.")
