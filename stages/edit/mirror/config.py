"""Settings of `pumps edit mirror`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from stages.shared.editing.settings import EditConfig


class Config(EditConfig):
    """Exchange left and right."""

    across: Literal["x", "z"] = Field(
        "x", description="Axis of the world along which it is mirrored; Y is up, whatever the file says."
    )
