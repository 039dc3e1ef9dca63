"""Settings of `pumps measure table1`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import SeededConfig, WritingConfig


class Config(WritingConfig, SeededConfig):
    """Join evaluations of the same windows into PUMPS Table 1: all methods beside each other, on one rig."""

    output: Path = Field(description="Folder of the metrics artefact.")
    metrics: tuple[Path, ...] = Field(
        description="Metrics artefacts of `pumps evaluate`, of other methods on the same windows.", min_length=1
    )
    curve: tuple[Path, ...] = Field(
        (), description="The same for methods of these names that were trained for other times: error against time."
    )
    ours: tuple[str, ...] = Field(
        (), description="Methods that are compared with the best of all others, pair by pair."
    )
