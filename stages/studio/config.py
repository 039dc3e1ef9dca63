"""Settings of `pumps studio`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import NAMES_OF, DeviceConfig
from stages.shared.weights.shipped import default_weights


class Config(DeviceConfig):
    """Open a page on this machine in which a person fills motion and sees the result."""

    input: Path | None = Field(None, description="Recording to open: a BVH, or any other format that pumps reads.")
    folder: Path | None = Field(
        None,
        description="The only folder that the page reads and writes; by default that of the recording, or the "
        "current one.",
    )
    weights: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights that the page chooses at first, by name (`pumps weights list`), or a folder with ae "
        "and lms.",
    )
    port: int = Field(0, description="Port on this machine; 0 for any free one.", ge=0, le=65535)
    browser: bool = Field(True, description="Open the page in the browser.")
