"""Settings of `pumps sample-tpc`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

from stages.shared.contract import SeededConfig, ShardedConfig, WritingConfig


class Config(WritingConfig, ShardedConfig, SeededConfig):
    """Turn a `motion` artefact into a `tpc` artefact (bones' transforms, or positions when baked)."""

    motion: Path = Field(description="The motion artefact to sample.")
    output: Path = Field(description="Folder of the tpc artefact.")
    where: str | None = Field(
        None,
        description="Which clips to use: an expression over the clip index, such as 'foot_skate < 0.1 and not "
        "t_pose'.",
    )
    points: int = Field(256, description="Points to draw for each skeleton.", ge=8)
    sigma_m: float = Field(
        0.05, description="Standard deviation of the points' offsets from the bones, in metres, for --bake.", ge=0
    )
    fps: float = Field(30.0, description="Frame rate to which clips are resampled.", gt=0)
    bake: bool = Field(
        False, description="Store the position of every point (dense) instead of the transforms of the bones (rigid)."
    )
    pack: bool = Field(
        False, description="Store the transforms in an eighth of the space; the error is a fraction of a millimetre."
    )
    mixed_rigs: float = Field(
        0.0,
        description="Fraction of the training clips to add a second time, on another rig of the collection.",
        ge=0,
        le=1,
    )

    @model_validator(mode="after")
    def _layouts_agree(self) -> Config:
        if self.bake and (self.pack or self.mixed_rigs):
            raise ValueError("--bake stores positions; --pack and --mixed-rigs are for bones' transforms")
        return self
