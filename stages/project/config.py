"""Settings of `pumps project`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field
from pydantic.config import JsonDict

from stages.shared.contract import OFTEN, VALUES, SeededConfig, WritingConfig
from stages.shared.formats.layout_names import KEYPOINT_LAYOUTS

_LAYOUTS: JsonDict = {**OFTEN, VALUES: [*KEYPOINT_LAYOUTS]}


class Config(WritingConfig, SeededConfig):
    """Project a motion into a camera, as 2D keypoints of a pose detector, with or without its errors."""

    input: Path = Field(
        description="Recording of any format that pumps reads (FILE.zip!MEMBER too), of which keypoints are made."
    )
    output: Path = Field(description="JSON to write, in the form of MMPose.")
    layout: str = Field("coco17", json_schema_extra=_LAYOUTS, description="Layout of the keypoints.")
    errors: Literal["none", "detector"] = Field(
        "none", json_schema_extra=OFTEN, description="detector: noise, missing points, swapped sides, confidences."
    )
    fov: float = Field(55.0, description="Horizontal field of view of the camera, in degrees.", gt=5, lt=150)
    image_size: str = Field("1920x1080", description="Width and height of the image in pixels.")
    azimuth: float | None = Field(
        None, description="Direction of the camera from the body in degrees: 0 is +Z, 90 is +X; default: random."
    )
    elevation: float | None = Field(None, description="Degrees by which the camera looks down; default: random.")
    distance: float | None = Field(None, description="Metres from the body's middle; default: random.", gt=0.2)
