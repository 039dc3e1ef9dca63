"""Settings of `pumps edit join`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig
from stages.shared.editing.settings import EditConfig, seconds_in
from stages.shared.weights.shipped import default_weights


class Config(EditConfig, DeviceConfig, SeededConfig):
    """Put a second clip after a first one, with filled frames between them."""

    then: Path = Field(description="Motion that follows, on the same rig.")
    blend: float = Field(0.5, description="Seconds of the frames between the two; 0 for none.", ge=0, le=10)
    weights: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights that fill, by name (`pumps weights list`), or a folder with ae and lms.",
    )

    _seconds = field_validator("blend", mode="before")(seconds_in)
