"""Settings of `pumps edit trim`."""

from __future__ import annotations

from pydantic import Field

from stages.shared.editing.settings import ManyEditsConfig


class Config(ManyEditsConfig):
    """Keep a range of a file's frames."""

    frames: str | None = Field(None, description="Frames to keep, such as 10:50 (without 50), 10: or :-5.")
    seconds: str | None = Field(None, description="Times to keep, in seconds, such as 0.5:2 or 1:.")
