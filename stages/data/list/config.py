"""Settings of `pumps data list`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import StageConfig


class Config(StageConfig):
    """List public data sets: licence, size, home page."""

    catalogue: Path | None = Field(None, description="Catalogue (TOML) to use instead of that of pumps.")
