"""Settings of `pumps estimate`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator
from pydantic.config import JsonDict

from stages.shared.contract import OFTEN, VALUES, DeviceConfig, SeededConfig, WritingConfig
from stages.shared.formats.layout_names import KEYPOINT_LAYOUTS

_LAYOUTS: JsonDict = {**OFTEN, VALUES: [*KEYPOINT_LAYOUTS]}


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Turn one person's 2D keypoints, or landmarks in 3D, into motion on a rig."""

    input: Path = Field(
        description="Keypoints: JSON of OpenPose (a folder of them), COCO, AlphaPose, MMPose or MediaPipe; "
        "DeepLabCut's CSV; npz or npy; or places of joints in 3D in any format that pumps reads."
    )
    output: Path = Field(description="File to write: .bvh with the rig's header; .glb, .npz, .csv or .parquet.")
    skeleton: Path | None = Field(
        None, json_schema_extra=OFTEN, description="Rig to put the motion on: a BVH; default: the weights' own."
    )
    person: int = Field(
        0, json_schema_extra=OFTEN, description="Which person: 0 for the one seen most, 1 for the next.", ge=0
    )
    layout: str | None = Field(
        None,
        json_schema_extra=_LAYOUTS,
        description="Layout of the keypoints, if it is not the one that the file or the number of points shows; for "
        "places in 3D the name of a joint list.",
    )
    image_size: str | None = Field(
        None, json_schema_extra=OFTEN, description="Width and height of the image, such as 1920x1080."
    )
    fps: float | None = Field(
        None, json_schema_extra=OFTEN, description="Frames a second; default: the file's, else 30.", gt=0.1, le=1000
    )
    fov: float | None = Field(
        None,
        json_schema_extra=OFTEN,
        description="Horizontal field of view of the camera in degrees; by default it is estimated.",
        gt=5,
        lt=150,
    )
    intrinsics: str | None = Field(
        None, description="Focal lengths and principal point of the camera in pixels: FX,FY,CX,CY."
    )
    weights: str = Field(
        "lifter",
        json_schema_extra=OFTEN,
        description="Network that lifts: shipped weights by name, or the folder of "
        "`pumps train finetune --task estimate --corruption detector`.",
    )
    method: Literal["solve", "turns"] = Field(
        "solve",
        description="How the motion is put on another rig, as for `pumps retarget`: solve or turns.",
    )
    page: Path | None = Field(
        None,
        json_schema_extra=OFTEN,
        description="HTML page to write, too: keypoints and the projected result, played together.",
    )

    @model_validator(mode="after")
    def _one_camera(self) -> Config:
        if self.fov is not None and self.intrinsics is not None:
            raise ValueError("--fov and --intrinsics both state the focal length; give one of them")
        return self
