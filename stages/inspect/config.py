"""Settings of `pumps inspect`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import StageConfig


class Config(StageConfig):
    """Describe what a motion file holds."""

    path: str = Field(
        description="File of any format that pumps reads (FILE.zip!MEMBER too), or an archive or folder whose "
        "files are listed."
    )
    map: bool = Field(False, description="Print only the skeleton map, as TOML to edit.")
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body; --map prints one."
    )
    skeleton: str | None = Field(
        None,
        description="Skeleton for files that have none: an ASF for AMC, a URDF for a robot's joint angles, a BVH "
        "or the name of a joint list for positions.",
    )
    body_models: Path | None = Field(None, description="Folder of SMPL-like body models (.npz), for AMASS files.")
    up_axis: Literal["y", "z"] | None = Field(
        None, description="Up axis of the files' world, if it is not the one that the body's poses show."
    )
    rest_frame: int | None = Field(None, description="Frame to use as the reference pose instead of an estimate.")
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one.", gt=0
    )
