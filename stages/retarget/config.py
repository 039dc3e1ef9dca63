"""Settings of `pumps retarget`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.config import DeviceConfig


class Config(DeviceConfig):
    """Give a motion to another skeleton, of which no pose of the motion is known."""

    input: Path = Field(description="The BVH that moves.")
    to: Path = Field(description="A BVH of the rig that is to move: its header, and its rest pose or a frame of it.")
    output: Path = Field(description="The BVH to write, with the rig's header.")
    method: Literal["turns", "solve"] = Field(
        "solve",
        description="turns: bones turn as answering bones turn; solve: then hands, feet and what lies between are "
        "drawn to where the source has them.",
    )
    points: int = Field(256, description="Points of the cloud that draws them.", ge=16, le=100_000)
    fps_override: float | None = Field(
        None, description="True frames a second, where the file's frame time is wrong."
    )
    overwrite: bool = Field(False, description="Replace the output if it exists.")
