"""Settings of `pumps export`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """Give a motion in a form that other programs read."""

    input: str = Field(
        description="A recording of any format that is read, 'archive.zip!member', or a motion artefact."
    )
    output: Path = Field(description="The file to write, or a folder for all clips of the input.")
    format: Literal["auto", "bvh", "glb", "amass", "csv", "parquet", "robot-csv"] = Field(
        "auto",
        description="What to write; auto goes by the output's suffix (.npz is amass; .csv is robot-csv where --rig is"
        " a URDF).",
    )
    clip: tuple[str, ...] = Field((), description="Only the clip of this name; all of them where none is named.")
    rig: str | None = Field(
        None,
        description="For BVH: a BVH whose header, unit and axes to write in; its joints must correspond. For"
        " robot-csv: the robot's URDF (default: --skeleton).",
    )
    values: Literal["both", "positions", "rotations"] = Field("both", description="What a CSV holds of each joint.")
    respect_limits: bool = Field(False, description="Keep a robot's angles within the limits that its URDF tells.")
    skeleton_map: Path | None = Field(
        None, description="TOML that says which joints are which part of the body (`pumps inspect FILE --map`)."
    )
    skeleton: str | None = Field(
        None,
        description="Skeleton of files that hold none: an ASF for AMC, a URDF for a robot's angles, a BVH or a list's"
        " name for positions.",
    )
    body_models: Path | None = Field(None, description="Folder of SMPL-like body models (.npz), for AMASS.")
    fps_override: float | None = Field(None, description="The true frame rate, where the file's is wrong.", gt=0)
