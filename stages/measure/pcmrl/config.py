"""Settings of `pumps measure pcmrl`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure as PC-MRL's tables do: filling a skeleton's own motions (Tables 1 and 3, with --truth), and motions
    adapted to another skeleton (Table 2, with --source)."""

    output: Path = Field(description="Folder of the metrics artefact.")
    truth: Path | None = Field(None, description="The tpc artefact of the skeleton's own motions, to be filled.")
    weights: tuple[str, ...] = Field((), description="NAME=FOLDER of an interpolator's checkpoint; each is a row.")
    category: tuple[str, ...] = Field(
        (), description="NAME=PATTERN: clips whose source matches; by default one for each archive."
    )
    source: Path | None = Field(None, description="The tpc artefact of the motions that were adapted.")
    adapted: tuple[str, ...] = Field((), description="NAME=TPC of the adapted motions; each is a row.")
    intervals: tuple[int, ...] = Field((5, 15, 30), description="Frames between keys.")
    sigmas_m: tuple[float, ...] = Field((0.0, 0.01, 0.05, 0.1, 0.2), description="Spreads of the compared clouds.")
    points: int = Field(1024, description="Points of the compared clouds.", ge=8)
    neighbours: int = Field(8, description="K of the distance of clouds.", ge=1)
    window: int = Field(121, description="Frames in a window.", ge=4)
    splits: tuple[str, ...] = Field(("test",), description="Which splits are measured.")
    max_windows: int = Field(
        0, description="Windows for each category, spread evenly over its clips; 0 for all.", ge=0
    )

    @model_validator(mode="after")
    def _something_is_measured(self) -> Config:
        if self.truth is None and self.source is None:
            raise ValueError("give truth (motions to fill), or source with adapted (motions to compare)")
        if (self.source is None) != (not self.adapted):
            raise ValueError("source and adapted go together")
        return self
