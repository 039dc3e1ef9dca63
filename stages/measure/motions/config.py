"""Settings of `pumps measure motions`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import SeededConfig, WritingConfig


class Config(WritingConfig, SeededConfig):
    """Measure motions beside the true ones, clip by clip: what came of decoding, solving or retargeting."""

    truth: Path = Field(description="The motion artefact of the true motions.")
    made: tuple[str, ...] = Field(
        description="NAME=MOTION: motion artefact of the same clips and joints; each is a row of the table."
    )
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    window: int = Field(120, description="Frames per window; shorter clips are measured as a whole.", ge=4)
    max_windows: int = Field(0, description="Windows per archive, spread evenly over the clips; 0 for all.", ge=0)
    output: Path = Field(description="Folder of the metrics artefact.")
