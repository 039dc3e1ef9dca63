"""Settings of `pumps edit mirror`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from stages.shared.editing.settings import ManyEditsConfig


class Config(ManyEditsConfig):
    """Exchange left and right."""

    across: Literal["auto", "x", "z"] = Field(
        "auto",
        description="Axis of the world along which it is mirrored, Y being up; auto takes the one from the body's "
        "left to its right at rest.",
    )
