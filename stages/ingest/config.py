"""Settings of `pumps ingest`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import ShardedConfig, WritingConfig


class Config(WritingConfig, ShardedConfig):
    """Read recordings into one `motion` artefact."""

    sources: tuple[str, ...] = Field(
        description="Files, folders, globs, zip or tar archives; - for a list of them on standard input."
    )
    output: Path = Field(description="Folder of the motion artefact.")
    format: Literal["auto", "bvh", "asf", "amass", "deepmimic", "robot", "positions", "gltf"] = Field(
        "auto", description="Format of the files; auto recognises each by its content."
    )
    splits: Path | None = Field(
        None, description="JSON of splits: {archive: {test: [...], val: [...]}}; the rest is train."
    )
    fps_override: tuple[str, ...] = Field(
        (), description="PATTERN=RATE, for example '*salsa*=60': the true frame rate."
    )
    trim_first: str = Field(
        "auto", description="Frames to drop at the start: a number, or auto (a calibration pose)."
    )
    skeleton: str | None = Field(
        None,
        description="Skeleton of files that hold none: an ASF for AMC, a URDF for a robot's angles, a BVH or a list's"
        " name for positions.",
    )
    skeleton_map: tuple[Path, ...] = Field(
        (),
        description="TOML with the body part of each joint of a rig (`pumps inspect FILE --map` prints one);"
        " each rig uses the one that matches its joints.",
    )
    body_models: Path | None = Field(None, description="Folder of SMPL-like body models (.npz), for AMASS.")
    licence: str | None = Field(None, description="Licence of sources that do not state one.")
    rest_frame: int | None = Field(None, description="Frame to use as the reference pose instead of estimating it.")
    strict: bool = Field(False, description="Stop at the first bad file instead of reporting and skipping it.")
    workers: int = Field(0, description="Number of reading processes; 0 for one per core.")
