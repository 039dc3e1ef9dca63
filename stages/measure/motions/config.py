"""Settings of `pumps measure motions`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import SeededConfig, WritingConfig


class Config(WritingConfig, SeededConfig):
    """Measure motions beside the true ones, clip by clip: what came of decoding, solving or retargeting."""

    truth: Path = Field(description="The motion artefact of the true motions.")
    made: tuple[str, ...] = Field(description="NAME=MOTION of motions of the same clips and joints; each is a row.")
    splits: tuple[str, ...] = Field(("test",), description="Which splits are measured.")
    window: int = Field(120, description="Frames in a window; shorter clips are measured whole.", ge=4)
    max_windows: int = Field(
        0, description="Windows for each archive, spread evenly over its clips; 0 for all.", ge=0
    )
    output: Path = Field(description="Folder of the metrics artefact.")
