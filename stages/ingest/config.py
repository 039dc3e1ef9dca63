"""Settings of `pumps ingest`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import ShardedConfig, WritingConfig


class Config(WritingConfig, ShardedConfig):
    """Read recordings into one `motion` artefact."""

    sources: tuple[str, ...] = Field(
        description="Files, folders, globs, zip or tar archives, FILE.zip!MEMBER; - reads a list of them from "
        "standard input."
    )
    output: Path = Field(description="Folder of the motion artefact.")
    format: Literal["auto", "bvh", "asf", "amass", "deepmimic", "robot", "positions", "gltf"] = Field(
        "auto", description="Format of the files; auto detects it for each file."
    )
    splits: Path | None = Field(
        None,
        description="JSON of splits, {archive: {test: [...], val: [...]}}, all other clips being for training; or "
        "{train: [...], test: [...]} with names of data sets or files, all others being left out.",
    )
    fps_override: tuple[str, ...] = Field(
        (), description="PATTERN=RATE, for example '*salsa*=60': the true frame rate of files whose name matches."
    )
    trim_first: str = Field(
        "auto", description="Frames to remove at the start: a number, or auto, which removes a calibration pose."
    )
    skeleton: str | None = Field(
        None,
        description="Skeleton for files that have none: an ASF for AMC, a URDF for a robot's joint angles, a BVH "
        "or the name of a joint list for positions.",
    )
    skeleton_map: tuple[Path, ...] = Field(
        (),
        description="TOML that assigns joints to parts of the body (`pumps inspect FILE --map` prints one). Each "
        "rig uses the one whose joints it has.",
    )
    body_models: Path | None = Field(None, description="Folder of SMPL-like body models (.npz), for AMASS files.")
    up_axis: Literal["y", "z"] | None = Field(
        None, description="Up axis of the files' world, if it is not the one that the body's poses show."
    )
    licence: str | None = Field(None, description="Licence of sources that do not state one.")
    rest_frame: int | None = Field(None, description="Frame to use as the reference pose instead of an estimate.")
    strict: bool = Field(False, description="Stop at the first bad file instead of skipping it.")
    workers: int = Field(0, description="Processes that read files; 0 for one per core.")
