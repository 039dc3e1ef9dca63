"""Settings of `pumps edit resample`."""

from __future__ import annotations

from pydantic import Field

from stages.shared.editing.settings import ManyEditsConfig


class Config(ManyEditsConfig):
    """Give a file another frame rate."""

    fps: float = Field(description="Frames per second to write.", gt=0, le=10_000)
