"""Settings of `pumps train ae`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

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
        description="Share of the steps whose points are spread evenly over the bones, as filling spreads them; in "
        "the others they are drawn at random.",
        ge=0,
        le=1,
    )
    loss: str = Field("assignment", description="Pairs of points: assignment, or chamfer (PUMPS Table 2).")
    prior_weight: float = Field(
        1.0,
        description="Weight of the codes' divergence from N(0, 1) where decoder.identities is vae; 1 is the VAE's "
        "own bound, with errors of a decimetre expected.",
        ge=0,
    )
    loss_points: int = Field(
        0, description="Points of a cloud that the loss pairs, drawn afresh each step; 0 for all."
    )
    variation_weight: float = Field(
        0.0,
        description="Extra weight of a pair's difference that varies over time; what is constant the keys take off.",
    )

    @field_validator("loss")
    @classmethod
    def _loss_exists(cls, value: str) -> str:
        if value not in LOSSES:
            raise ValueError(f"must be one of {', '.join(LOSSES)}")
        return value
