"""Settings of `pumps retarget`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from stages.shared.contract import DeviceConfig, MotionFilesConfig, SeededConfig


class Config(MotionFilesConfig, DeviceConfig, SeededConfig):
    """Give a motion to another skeleton, of which no pose of the motion is known."""

    input: Path = Field(
        description="Recording whose motion is used: a BVH or any other format that pumps reads. FILE.zip!MEMBER "
        "reads from an archive; of a folder, an archive or a pattern, each file is retargeted."
    )
    to: Path = Field(
        description="Target rig: a BVH with its header and its rest pose or a motion, whose joints rotate freely;"
        " or a robot's URDF, whose joints rotate about their axes."
    )
    output: Path = Field(
        description="File to write: .bvh has the rig's header, and .csv for a robot its joint angles; .glb, .npz,"
        " .csv and .parquet are written as `pumps export` does."
    )
    method: Literal["turns", "solve", "network", "both"] = Field(
        "solve",
        description="How to retarget. turns: copy the rotation of corresponding bones. solve: then move hands, "
        "feet and limbs to where they are in the source. network: use the rig's network. both: solve,"
        " starting from the network's pose.",
    )
    network: Path | None = Field(
        None, description="Network of the rig (`pumps train skeleton`), for the methods network and both."
    )
    points: int = Field(256, description="Points per cloud, for all methods but turns.", ge=16, le=100_000)
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one."
    )
    up_axis: Literal["y", "z"] | None = Field(
        None, description="Up axis of the files' world, if it is not the one that the body's poses show."
    )
    skeleton: str | None = Field(
        None,
        description="Skeleton for files that have none: an ASF for AMC, a URDF for a robot's joint angles, a BVH "
        "or the name of a joint list for positions.",
    )
    respect_limits: bool = Field(False, description="Keep the angles of a robot within the limits in its URDF.")

    @model_validator(mode="after")
    def _network_fits(self) -> Config:
        if (self.method in ("network", "both")) != (self.network is not None):
            raise ValueError("--network goes with the methods network and both, and they need it")
        return self
