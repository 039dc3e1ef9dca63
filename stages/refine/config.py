"""Settings of `pumps refine`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Find the flawed frames of motions of known actions and mend them, on their own rig."""

    input: Path = Field(
        description="Motion to refine, of any format that pumps reads (FILE.zip!MEMBER too), or a motion artefact."
    )
    output: Path = Field(
        description="File to write: .bvh, .glb, .npz, .csv or .parquet; for an artefact, the folder of another one."
    )
    action: str | None = Field(
        None,
        description="The motion's action, one that the weights were trained on; default for an artefact: that in "
        "each clip's source.",
    )
    actions: str = Field(
        "auto",
        description="For an artefact, a regular expression with a group that is the action in a clip's source; auto "
        "knows the names of Bandai Namco, HDM05 and HumanAct12, and of `pumps generate`.",
    )
    weights: Path = Field(description="Checkpoint of `pumps train concepts`, of the same rig.")
    only: Literal["anchors", "transitions"] | None = Field(
        None, description="Refine the flawed anchors alone, or the transitions alone; default: both."
    )
    table: Path | None = Field(None, description="CSV to write: each anchor, its score, and what changed.")
    page: Path | None = Field(
        None, description="HTML page to write: poses before and after, with the anchors and their scores."
    )
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one.", gt=0, lt=1e6
    )
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body (`pumps inspect FILE --map` prints one)."
    )
