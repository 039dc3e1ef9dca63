"""Settings of `pumps measure constraints`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig, WritingConfig
from stages.shared.weights.shipped import default_weights

CONSTRAINTS = ("arms", "legs", "hands", "path")


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure filling under constraints taken from the truth, beside filling between the same keys without them."""

    motion: Path = Field(description="The motion artefact whose clips are filled.")
    output: Path = Field(description="Folder of the metrics artefact.")
    weights: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights by name (`pumps weights list`), or a folder with ae and lms.",
    )
    constraints: tuple[str, ...] = Field(
        CONSTRAINTS,
        description="arms, legs: these alone are filled; hands: both hands are at their true places; path: the "
        "pelvis is on its true path over the ground.",
    )
    interval: int = Field(30, description="Frames between keyframes, at 30 a second.", ge=2)
    window: int = Field(121, description="Frames per window.", ge=4)
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    category: tuple[str, ...] = Field(
        (), description="NAME=PATTERN: clips whose source matches, such as Walk=*walk*; by default one per archive."
    )
    max_windows: int = Field(0, description="Windows per category, spread evenly over the clips; 0 for all.", ge=0)

    @field_validator("constraints")
    @classmethod
    def _constraints_exist(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [name for name in value if name not in CONSTRAINTS]
        if unknown or not value:
            raise ValueError(f"must name some of {', '.join(CONSTRAINTS)}, not {', '.join(unknown) or 'none'}")
        return value
