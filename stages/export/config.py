"""Settings of `pumps export`."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Literal

from pydantic import Field

from data_schemas.errors import UsageError
from stages.shared.contract import MotionFilesConfig

_OWN_SUFFIXES = {"amass": ".npz", "robot-csv": ".csv"}  # of formats that are not named as their suffix is


class Config(MotionFilesConfig):
    """Give a motion in a form that other programs read."""

    input: str = Field(
        description="Recording of any format that pumps reads (FILE.zip!MEMBER too), or a motion artefact; of a "
        "folder, an archive or a pattern, each file is written."
    )
    output: Path = Field(description="File to write, or a folder for all clips of the input.")
    format: Literal["auto", "bvh", "glb", "amass", "csv", "parquet", "robot-csv"] = Field(
        "auto",
        description="Format to write; auto chooses by the suffix of the output: .npz is amass, and .csv is "
        "robot-csv if --rig is a URDF.",
    )
    clip: tuple[str, ...] = Field((), description="Name of a clip to write; by default all.")
    rig: str | None = Field(
        None,
        description="For bvh: a BVH whose header, unit and axes are used, and whose joints correspond to the "
        "clip's. For robot-csv: the robot's URDF (default: --skeleton).",
    )
    values: Literal["both", "positions", "rotations"] = Field("both", description="What a CSV holds for each joint.")
    respect_limits: bool = Field(False, description="Keep the angles of a robot within the limits in its URDF.")
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body (`pumps inspect FILE --map` prints one)."
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
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one.", gt=0
    )

    def suffix_of(self, own: str, writable: Collection[str]) -> str:
        """The format's suffix, or the one asked for."""
        if self.format == "auto":
            if self.suffix is None:
                raise UsageError(f"{self.output} is a folder, so it is not said what to write.", "Give --format.")
            return super().suffix_of(own, writable)
        suffix = _OWN_SUFFIXES.get(self.format, f".{self.format}")
        if self.suffix is not None and self.suffix.lower() != suffix:
            raise UsageError(
                f"--suffix {self.suffix} is not one of {self.format}.", f"Leave it out, or give {suffix}."
            )
        return suffix
