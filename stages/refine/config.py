"""Settings of `pumps refine`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Find the flawed frames of a motion of a known action and mend them, on its own rig."""

    input: Path = Field(
        description="Motion to refine, of any format that pumps reads. FILE.zip!MEMBER reads from an archive."
    )
    output: Path = Field(description="File to write: .bvh, .glb, .npz, .csv or .parquet.")
    action: str = Field(description="The motion's action, one that the weights were trained on.")
    weights: Path = Field(description="Checkpoint of `pumps train concepts`, of the same rig.")
    only: Literal["anchors", "transitions"] | None = Field(
        None, description="Refine the flawed anchors alone, or the transitions alone; default: both."
    )
    table: Path | None = Field(None, description="CSV to write: each anchor, its score, and what changed.")
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one.", gt=0, lt=1e6
    )
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body (`pumps inspect FILE --map` prints one)."
    )
