"""Settings of `pumps measure body-parts`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig, WritingConfig
from stages.shared.humanoid.decompositions import LIMBS


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure autoencoders of body parts: reconstruction, noise, where an error stays."""

    motion: str = Field(description="NAME=FOLDER of the motion artefact that the parts were trained on.")
    unseen: tuple[str, ...] = Field((), description="NAME=FOLDER of motion artefacts that no part was trained on.")
    weights: tuple[str, ...] = Field(
        description="NAME=FOLDER of `pumps train body-parts`; FOLDER:PART+FOLDER:PART puts parts together.",
        min_length=1,
    )
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Splits of --motion to measure.")
    unseen_splits: tuple[str, ...] = Field(
        ("train", "val", "test"), description="Splits of --unseen to measure; all are unseen."
    )
    max_windows: int = Field(200, description="Windows per data set, spread evenly over its clips; 0 for all.", ge=0)
    clip_seconds: float = Field(20.0, description="Seconds of each clip, from its start; 0 for all.", ge=0)
    seeds: int = Field(7, description="Seeds of the noise and of drawn latents.", ge=1)
    noise_deg: float = Field(
        5.0, description="Input noise: standard deviation of a random turn about each axis, degrees.", ge=0
    )
    zeroed: float = Field(
        0.1, description="Latent noise: share of the latent's numbers that are set to zero.", ge=0, le=1
    )
    tampered: float = Field(
        1.0,
        description="Locality: noise added to one part's latent, in its standard deviations; 0 leaves this out.",
        ge=0,
    )
    blend: float = Field(
        0.0, description="Weight of a limb's own rotation of its connector; 0 takes the spine's.", ge=0, le=1
    )
    pumps: str | None = Field(
        None,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights of `pumps infill` that also complete lost limbs, to compare with the bodies; without "
        "them no limb is lost.",
    )
    lost: tuple[str, ...] = Field(
        ("left_leg", "right_leg"), description="With --pumps: limbs that are lost, of " + ", ".join(LIMBS) + "."
    )
    lost_seconds: float = Field(
        1.0, description="How long limbs are lost, in seconds, rounded to whole windows.", gt=0, le=60
    )
    lost_stretches: int = Field(
        40, description="Stretches of each data set with lost limbs, spread evenly over its clips.", ge=1
    )

    @field_validator("lost")
    @classmethod
    def _are_limbs(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [name for name in value if name not in LIMBS]
        if unknown or not value:
            raise ValueError(f"must name some of {', '.join(LIMBS)}, not {', '.join(unknown) or 'none'}")
        return value
