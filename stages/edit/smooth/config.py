"""Settings of `pumps edit smooth`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator

from stages.shared.editing.settings import ManyEditsConfig, seconds_in


class Config(ManyEditsConfig):
    """Smooth a whole motion in time."""

    seconds: float = Field(0.3, description="Time over which each frame is averaged.", gt=0, le=10)
    method: Literal["savgol", "butterworth"] = Field(
        "savgol",
        description="savgol fits a curve of degree 3; butterworth removes movement that goes back and "
        "forth in less than about --seconds.",
    )

    _seconds = field_validator("seconds", mode="before")(seconds_in)
