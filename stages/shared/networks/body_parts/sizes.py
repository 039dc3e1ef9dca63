"""Settings of body-part networks that stages share. Imports no torch."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class LossWeights(BaseModel):
    """The weights of eq. 1 (de Clermont Gallerande et al. 2025), terms as in `losses.reconstruction_terms`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    mse: float = Field(default=1.0, description="Weight of the squared error of the rotations' columns.", ge=0)
    mpjae: float = Field(default=1.0, description="Weight of the angles between global rotations.", ge=0)
    mpjlae: float = Field(
        default=0.1, description="Weight of the angles between rotations in the parents' frames.", ge=0
    )
    av: float = Field(default=0.001, description="Weight of the change of these angles over time.", ge=0)
    aa: float = Field(default=0.01, description="Weight of the change of that change.", ge=0)
    mpjpe: float = Field(default=0.1, description="Weight of the distance of the joints, in metres.", ge=0)
    jerk: float = Field(default=0.001, description="Weight of the distance of the joints' third differences.", ge=0)
