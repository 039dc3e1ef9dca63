"""Settings of `pumps sample-tpc`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.config import ShardedConfig


class Config(ShardedConfig):
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
