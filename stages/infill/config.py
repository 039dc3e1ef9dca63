"""Settings of `pumps infill`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig
from stages.shared.weights.shipped import default_weights


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Fill a BVH, or a robot's joint angles, between its keyframes, on its own skeleton."""

    input: Path = Field(
        description="The BVH, or the CSV of a robot's joint angles, to fill; rows that are no keyframes are junk and"
        " never read."
    )
    output: Path = Field(description="The file to write, in the input's own layout.")
    keyframes: str | None = Field(
        None, description="0,15,40 or every:15 or slices such as 40: and 10:20, joined by commas."
    )
    transition: str | None = Field(None, description="A:B, frames A to B-1 are missing, all others are keys.")
    predict: int | None = Field(None, description="Append this many frames after the last.")
    times: str | None = Field(None, description="The input's rows are keys alone: their times in seconds.")
    frames: str | None = Field(
        None, description="The input's rows are keys alone: their frame numbers in the output."
    )
    weights: str = Field(
        default_factory=default_weights,
        description="A shipped set of weights by name (pumps weights list), or a folder that holds ae and lms.",
    )
    fps_override: float | None = Field(None, description="The true frame rate, where the file's is wrong.")
    skeleton: str | None = Field(
        None, description="For a robot's joint angles: its URDF ('archive.zip!robot.urdf' too), if none lies beside."
    )
    respect_limits: bool = Field(
        False, description="Keep a robot's filled angles within the limits that its URDF tells."
    )
    skeleton_map: Path | None = Field(
        None, description="TOML that says which joints are which part of the body (`pumps inspect FILE --map`)."
    )
    foot_lock: bool = Field(True, description="Hold feet that stand where they stand, by turning the legs.")
    points: int = Field(256, description="Points of the cloud.", ge=16, le=100_000)
