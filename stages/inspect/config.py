"""Settings of `pumps inspect`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import StageConfig


class Config(StageConfig):
    """Describe what a motion file holds."""

    path: str = Field(
        description="A file of any format that pumps reads, 'archive.zip!member', or an archive or folder to list."
    )
    map: bool = Field(False, description="Print only the skeleton map, ready to edit.")
    skeleton_map: Path | None = Field(None, description="TOML with the body part of each joint; --map prints one.")
    skeleton: str | None = Field(
        None,
        description="Skeleton of files that hold none: an ASF for AMC, a URDF for a robot's angles, a BVH or a list's"
        " name for positions.",
    )
    body_models: Path | None = Field(None, description="Folder of SMPL-like body models (.npz), for AMASS.")
    rest_frame: int | None = Field(None, description="Frame to use as the reference pose instead of estimating it.")
    fps_override: float | None = Field(None, description="The true frame rate, if the file's is wrong.", gt=0)
