"""Settings of `pumps inspect`."""

from __future__ import annotations

from pydantic import Field

from stages.config import StageConfig


class Config(StageConfig):
    """Tell what a motion file holds."""

    path: str = Field(description="A BVH file, 'archive.zip!member', or an archive or folder to list.")
    rest_frame: int | None = Field(None, description="Frame to take as the reference pose instead of estimating it.")
