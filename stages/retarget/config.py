"""Settings of `pumps retarget`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Give a motion to another skeleton, of which no pose of the motion is known."""

    input: Path = Field(
        description="The recording that moves, a BVH or any other that is read; of an archive: FILE.zip!MEMBER."
    )
    to: Path = Field(
        description="The rig that is to move. A BVH of it: its header, and its rest pose or a frame of it; its joints"
        " turn freely. Or a robot's URDF: its joints turn about their axes."
    )
    output: Path = Field(
        description="The file to write: a BVH with the rig's header; of a robot its joint angles (.csv) or a .bvh."
    )
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
    skeleton: str | None = Field(
        None,
        description="Skeleton of an input that has none: an ASF for AMC, a URDF for a robot's angles, a BVH or a"
        " list's name for positions.",
    )
    respect_limits: bool = Field(False, description="Keep a robot's angles within the limits that its URDF tells.")

    @model_validator(mode="after")
    def _network_fits(self) -> Config:
        if (self.method in ("network", "both")) != (self.network is not None):
            raise ValueError("--network goes with the methods network and both, and they need it")
        return self
