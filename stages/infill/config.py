"""Settings of `pumps infill`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from stages.shared.contract import NAMES_OF, DeviceConfig, MotionFilesConfig, SeededConfig
from stages.shared.weights.shipped import default_weights


class Config(MotionFilesConfig, DeviceConfig, SeededConfig):
    """Fill a BVH, or a robot's joint angles, between its keyframes, on its own skeleton."""

    input: Path = Field(
        description="File to fill: a BVH, or a CSV of a robot's joint angles. Rows between keyframes are "
        "ignored. FILE.zip!MEMBER reads from an archive; of a folder, an archive or a pattern, each file is filled."
    )
    output: Path = Field(
        description="File to write. With the input's suffix it keeps the input's layout; .bvh, .glb, .npz, .csv "
        "and .parquet are written as `pumps export` does."
    )
    keyframes: str | None = Field(
        None,
        description="Which rows are keyframes: 0,15,40 or every:15 or ranges such as 40: and 10:20, joined by "
        "commas. arms=0,15,40 names keyframes of a part of the body; several are joined by semicolons.",
    )
    keep: tuple[str, ...] = Field(
        (),
        description="PART:FRAMES, such as legs:all or left_arm:10-40: what the file holds there is kept. A part is a "
        "body group, arms, legs, upper_body, lower_body, root, position, or a joint.",
    )
    pin: tuple[str, ...] = Field(
        (),
        description="END:FRAMES, such as right_hand:10-40: the end stays at its place in the world. An end is "
        "left_hand, right_hand, left_foot, right_foot, head, or a joint.",
    )
    path: Path | None = Field(
        None,
        description="CSV with columns frame, x, z, or frame, x, y, z: where the pelvis moves, metres, Y up.",
    )
    lock: tuple[str, ...] = Field(
        (), description="PART or PART:FRAMES: joints that only turn from keyframe to keyframe, without the models."
    )
    constraints: Path | None = Field(
        None, description="JSON with all of these (`docs/formats.md`), or Kimodo's constraints of type root2d."
    )
    transition: str | None = Field(
        None, description="A:B: frames A to B-1 are missing, and all others are keyframes."
    )
    predict: int | None = Field(None, description="Frames to add after the last one.")
    times: str | None = Field(
        None, description="The rows of the input are keyframes only, at these times in seconds: 0,0.5,1.25."
    )
    frames: str | None = Field(
        None, description="The rows of the input are keyframes only, with these frame numbers in the output: 0,15,40."
    )
    method: Literal["pumps", "concepts"] = Field(
        "pumps",
        description="pumps fills any rig by the models of --weights. concepts fills the rig that `pumps train "
        "concepts` was given, from one whole keyframe to the next.",
    )
    weights: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights that come with pumps, by name (`pumps weights list`), or a folder with ae and lms; with "
        "--method concepts the checkpoint of `pumps train concepts`.",
    )
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one."
    )
    up_axis: Literal["y", "z"] | None = Field(
        None, description="Up axis of the file's world, if it is not the one that the body's poses show."
    )
    skeleton: str | None = Field(
        None, description="For a robot's joint angles: its URDF, if the folder of the input has none."
    )
    respect_limits: bool = Field(False, description="Keep the angles of a robot within the limits in its URDF.")
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body (`pumps inspect FILE --map` prints one)."
    )
    samples: int = Field(
        1,
        description="Number of different plausible fills. The first is the usual one; of several, NAME-1.bvh, "
        "NAME-2.bvh and so on are written.",
        ge=1,
        le=1000,
    )
    sample: int | None = Field(
        None,
        description="The one of several fills to write alone: NAME.bvh is what --samples writes as NAME-SAMPLE.bvh.",
        ge=1,
        le=1000,
    )
    foot_lock: bool = Field(True, description="Keep planted feet in place by adjusting the legs.")
    points: int = Field(256, description="Points per cloud.", ge=16, le=100_000)

    @model_validator(mode="after")
    def _one_or_several(self) -> Config:
        if self.sample is not None and self.samples > 1:
            raise ValueError("sample names one fill and samples asks for several: give one of them")
        return self

    @property
    def wanted(self) -> tuple[int, ...]:
        """Numbers of the fills to make, from 1, the usual one."""
        return tuple(range(1, self.samples + 1)) if self.sample is None else (self.sample,)

    def outputs_of(self, output: Path) -> tuple[Path, ...]:
        """`clip.bvh`, or `clip-1.bvh`, `clip-2.bvh` and so on where several fills are wanted."""
        if self.samples == 1:
            return (output,)
        return tuple(output.with_name(f"{output.stem}-{n}{output.suffix}") for n in range(1, self.samples + 1))
