"""Settings of `pumps data fetch`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import StageConfig


class Config(StageConfig):
    """Download a public data set, going on where an earlier try broke off, and check it."""

    name: str = Field(description="The data set (`pumps data list`).")
    output: Path = Field(Path("data"), description="Folder to download into.")
    accept_licence: bool = Field(False, description="Accept the data set's licence; asked for once.")
    catalogue: Path | None = Field(None, description="Another catalogue (TOML) than the one that comes with pumps.")
    acceptances: Path | None = Field(None, description="File that remembers accepted licences; default: the user's.")
