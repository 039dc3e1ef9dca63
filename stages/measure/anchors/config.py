"""Settings of `pumps measure anchors`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Fill clips between their anchors, and between as many evenly spaced keys, and measure both."""

    motion: Path = Field(description="The motion artefact.")
    weights: str | None = Field(
        None, json_schema_extra={NAMES_OF: "weights"}, description="Weights that fill too; default: slerp alone."
    )
    lambdas: tuple[float, ...] = Field((100, 200, 300, 400), description="Prices of a transition to measure.")
    degree: int = Field(
        3, description="Degree of the curves that choose the anchors, as in `pumps segment`.", ge=1, le=3
    )
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    max_clips: int = Field(0, description="Clips to measure, spread evenly over the list of clips; 0 for all.", ge=0)
    longest_s: float = Field(20.0, description="Seconds of each clip to measure, from its first frame.", gt=0)
    output: Path = Field(description="Folder of the metrics artefact.")
