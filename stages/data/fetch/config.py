"""Settings of `pumps data fetch`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import NAMES_OF, WritingConfig


class Config(WritingConfig):
    """Download a public data set, going on where an earlier try broke off, and check it."""

    name: str = Field(json_schema_extra={NAMES_OF: "data sets"}, description="Data set (`pumps data list`).")
    output: Path = Field(Path("data"), description="Folder to download to; files that are complete stay.")
    accept_licence: bool = Field(False, description="Accept the licence of the data set; needed once.")
    catalogue: Path | None = Field(None, description="Catalogue (TOML) to use instead of that of pumps.")
    acceptances: Path | None = Field(
        None, description="File that stores accepted licences; by default in the user's configuration."
    )
