"""Settings of `pumps sample-tpc`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

from stages.shared.contract import SeededConfig, ShardedConfig, WritingConfig


class Config(WritingConfig, ShardedConfig, SeededConfig):
    """Turn a `motion` artefact into a `tpc` artefact (bones' transforms, or positions when baked)."""

    motion: Path = Field(description="The motion artefact.")
    output: Path = Field(description="Folder of the tpc artefact.")
    where: str | None = Field(
        None, description="Which clips: an expression of their index, 'foot_skate < 0.1 and not t_pose'."
    )
    points: int = Field(256, description="Points drawn for each skeleton.", ge=8)
    sigma_m: float = Field(0.05, description="Standard deviation of a baked cloud's offsets, metres.", ge=0)
    fps: float = Field(30.0, description="Rate that clips are resampled to.", gt=0)
    bake: bool = Field(
        False, description="Store every point's position (dense) instead of bones' transforms (rigid)."
    )
    pack: bool = Field(
        False, description="Store bones' transforms in an eighth of the space, exact to fractions of a millimetre."
    )
    mixed_rigs: float = Field(
        0.0, description="Share of the training clips to add on another rig of the collection as well.", ge=0, le=1
    )

    @model_validator(mode="after")
    def _layouts_agree(self) -> Config:
        if self.bake and (self.pack or self.mixed_rigs):
            raise ValueError("--bake stores positions; --pack and --mixed-rigs are for bones' transforms")
        return self
