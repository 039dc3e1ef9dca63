"""Settings of `pumps segment`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import SeededConfig, WritingConfig


class Config(WritingConfig, SeededConfig):
    """Segment motions at their anchor frames, between which each joint follows one cubic (motion concepts)."""

    input: Path = Field(
        description="File of any format that pumps reads (FILE.zip!MEMBER too), a motion artefact, or a folder of "
        "--data-set."
    )
    output: Path | None = Field(None, description="Folder of the concepts artefact.")
    keyframes: bool = Field(
        False, description="Print the anchors of a file as a list that `pumps infill --keyframes` takes."
    )
    lambda_: float = Field(
        200.0,
        description="Price of a transition, in cm^2 summed over 24 joints at 20 frames a second, on a body of 1.5 m "
        "up to the head's joint. More gives fewer anchors; the paper varies it from 100 to 400.",
        gt=0,
    )
    degree: int | None = Field(
        None,
        description="Degree of the curves that choose the anchors. 3: the paper's. 1: where straight lines between "
        "anchors are nearest to the motion. Default: 3, and 1 with --keyframes.",
        ge=1,
        le=3,
    )
    longest_s: float = Field(4.0, description="Longest transition, in seconds.", gt=0, le=60)
    fps: float | None = Field(
        None, description="Rate at which motions are segmented and stored, in frames per second; default: their own.",
        gt=0, le=1000,
    )  # fmt: skip
    data_set: Literal["humanact12", "uestc", "action2motion"] | None = Field(
        None,
        description="The input is a folder of this data set of joint positions, as its public code reads it. For "
        "action2motion it is the published output of one generator: a folder, or ARCHIVE!FOLDER.",
    )
    actions: str = Field(
        "auto",
        description="Regular expression with a group that is the action in a clip's source; auto knows the names of "
        "Bandai Namco, HDM05 and HumanAct12.",
    )
    cluster: Literal["none", "kmeans", "dbscan", "optics", "ward"] = Field(
        "none", description="Group the anchors of each action into anchor concepts (needs scikit-learn)."
    )
    clusters: int | None = Field(
        None,
        description="Anchor concepts of each action; default: the fewest that leave a quarter of the variance.",
        ge=2,
        le=200,
    )
    page: Path | None = Field(None, description="HTML page to write, with pictures of the anchor concepts.")
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one.", gt=0, lt=1e6
    )
    skeleton: str | None = Field(
        None,
        description="Skeleton for files that have none: an ASF for AMC, a URDF for a robot's joint angles, a BVH "
        "or the name of a joint list for positions.",
    )
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body (`pumps inspect FILE --map` prints one)."
    )
