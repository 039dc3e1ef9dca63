"""Settings of `pumps edit loop`."""

from __future__ import annotations

from pydantic import Field, field_validator

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig
from stages.shared.editing.settings import ManyEditsConfig, seconds_in
from stages.shared.weights.shipped import default_weights


class Config(ManyEditsConfig, DeviceConfig, SeededConfig):
    """Add frames that lead from a clip's last pose to its first one, at the place where the clip ends."""

    blend: float | None = Field(
        None,
        description="Seconds to add; by default the time that the way to the first pose takes at the clip's usual "
        "speed, or longer where a seam is not smooth, 0.1 to 1 s.",
        gt=0,
        le=10,
    )
    weights: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights that fill, by name (`pumps weights list`), or a folder with ae and lms.",
    )

    _seconds = field_validator("blend", mode="before")(seconds_in)
