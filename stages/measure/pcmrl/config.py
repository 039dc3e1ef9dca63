"""Settings of `pumps measure pcmrl`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure as PC-MRL's tables do: filling a skeleton's own motions (Tables 1 and 3, with --truth), and motions
    adapted to another skeleton (Table 2, with --source)."""

    output: Path = Field(description="Folder of the metrics artefact.")
    truth: Path | None = Field(None, description="The tpc artefact of the skeleton's own motions, which are filled.")
    weights: tuple[str, ...] = Field(
        (), description="NAME=FOLDER of the checkpoint of an interpolator; each is a row of the table."
    )
    category: tuple[str, ...] = Field(
        (), description="NAME=PATTERN: clips whose source matches; by default one category per archive."
    )
    source: Path | None = Field(None, description="The tpc artefact of the motions before they were adapted.")
    adapted: tuple[str, ...] = Field(
        (), description="NAME=TPC: tpc artefact of adapted motions; each is a row of the table."
    )
    intervals: tuple[int, ...] = Field((5, 15, 30), description="Frames between keyframes.")
    sigmas_m: tuple[float, ...] = Field(
        (0.0, 0.01, 0.05, 0.1, 0.2),
        description="Standard deviations of the points' offsets in the compared clouds, in metres.",
    )
    points: int = Field(1024, description="Points per compared cloud.", ge=8)
    neighbours: int = Field(8, description="Number of nearest neighbours in the distance between clouds.", ge=1)
    window: int = Field(121, description="Frames per window.", ge=4)
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    max_windows: int = Field(0, description="Windows per category, spread evenly over the clips; 0 for all.", ge=0)

    @model_validator(mode="after")
    def _something_is_measured(self) -> Config:
        if self.truth is None and self.source is None:
            raise ValueError("give truth (motions to fill), or source with adapted (motions to compare)")
        if (self.source is None) != (not self.adapted):
            raise ValueError("source and adapted go together")
        return self
