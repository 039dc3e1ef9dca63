"""Settings of `pumps train ae`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import OFTEN
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes
from stages.shared.training.config import TrainingConfig

LOSSES = ("assignment", "chamfer")


class Config(TrainingConfig):
    """Train the autoencoder of clouds on a `tpc` artefact (PUMPS 3.1, 3.2)."""

    tpc: Path = Field(description="The tpc artefact to learn from.")
    encoder: EncoderSizes = EncoderSizes()
    decoder: DecoderSizes = DecoderSizes()
    even_share: float = Field(
        0.0,
        json_schema_extra=OFTEN,
        description="Fraction of the steps in which points are spread evenly over the bones, as in filling; in "
        "the other steps they are drawn at random.",
        ge=0,
        le=1,
    )
    loss: str = Field(
        "assignment",
        json_schema_extra=OFTEN,
        description="How predicted and true points are paired: assignment, or chamfer (PUMPS Table 2).",
    )
    prior_weight: float = Field(
        1.0,
        description="With --decoder.identities vae: weight of the codes' divergence from N(0, 1). 1 gives the "
        "VAE's own bound if errors are about 0.1 m.",
        ge=0,
    )
    loss_points: int = Field(
        0, description="Points per cloud that the loss compares, drawn again for each step; 0 for all."
    )
    variation_weight: float = Field(
        0.0,
        description="Extra weight of the part of the error that varies over time; keyframes correct the constant "
        "part.",
    )

    @field_validator("loss")
    @classmethod
    def _loss_exists(cls, value: str) -> str:
        if value not in LOSSES:
            raise ValueError(f"must be one of {', '.join(LOSSES)}")
        return value
