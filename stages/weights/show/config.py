"""Settings of `pumps weights show`."""

from __future__ import annotations

from pydantic import Field

from stages.shared.contract import NAMES_OF, StageConfig
from stages.shared.weights.shipped import default_weights


class Config(StageConfig):
    """Tell what is known of some weights: licences, size, training, validation, what they are good and bad at."""

    name: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights that come with pumps, by name (`pumps weights list`), or a folder with ae and lms.",
    )
