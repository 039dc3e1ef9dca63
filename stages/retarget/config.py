"""Settings of `pumps retarget`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from stages.shared.contract import DeviceConfig


class Config(DeviceConfig):
    """Give a motion to another skeleton, of which no pose of the motion is known."""

    input: Path = Field(description="The BVH that moves; of an archive: FILE.zip!MEMBER.")
    to: Path = Field(
        description="A BVH of the rig that is to move: its header, and its rest pose or a frame of it. Its joints "
        "turn freely: limits of poses, such as a robot's hinges, are not kept."
    )
    output: Path = Field(description="The BVH to write, with the rig's header.")
    method: Literal["turns", "solve", "network", "both"] = Field(
        "solve",
        description="turns: bones turn as answering bones turn. solve: then hands, feet and what lies between are "
        "drawn to where the source has them. network: as the rig's network says of the source's cloud. both: the "
        "solve from the network's pose.",
    )
    network: Path | None = Field(None, description="The rig's network (`pumps train skeleton`), for these two.")
    points: int = Field(256, description="Points of the cloud that draws them.", ge=16, le=100_000)
    fps_override: float | None = Field(
        None, description="True frames a second, where the file's frame time is wrong."
    )
    overwrite: bool = Field(False, description="Replace the output if it exists.")

    @model_validator(mode="after")
    def _network_fits(self) -> Config:
        if (self.method in ("network", "both")) != (self.network is not None):
            raise ValueError("--network goes with the methods network and both, and they need it")
        return self
