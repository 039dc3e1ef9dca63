"""Settings of `pumps weights fetch`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Download weights, check them, and keep them where `--weights NAME` finds them."""

    source: str = Field(
        description="Name in the registry, or the address (http, https) of an archive: .zip, .tar, .tar.gz, .tar.xz."
    )
    registry: str | None = Field(
        None, description="Registry of weights: a TOML file, or its address (docs/pretraining.md has the format)."
    )
    checksum: str | None = Field(
        None, description="Of an archive that is given by its address: sha256:<64 hex digits>."
    )
    accept_licence: bool = Field(False, description="Accept the licence of the weights; needed once.")
    output: Path | None = Field(
        None, description="Folder to keep them in, under their name; by default in the user's cache."
    )
    acceptances: Path | None = Field(
        None, description="File that stores accepted licences; by default in the user's configuration."
    )
