"""Settings of `pumps train body-parts`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from stages.shared.contract import OFTEN
from stages.shared.humanoid.decompositions import DECOMPOSITIONS
from stages.shared.networks.body_parts.sizes import LossWeights
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train autoencoders of body parts, each by itself (de Clermont Gallerande et al. 2025)."""

    motion: Path = Field(description="The motion artefact.")
    parts: int = Field(
        5,
        json_schema_extra=OFTEN,
        description="The decomposition: 1 the whole body; 2 upper, lower; 3 spine, arms, legs; 5 body groups.",
    )
    part: str | None = Field(
        None,
        json_schema_extra=OFTEN,
        description="Train this part of the decomposition alone, such as left_arm; by default all of them.",
    )
    network: Literal["ae", "pae", "vae", "svae"] = Field(
        "ae",
        json_schema_extra=OFTEN,
        description="ae, periodic (pae), variational (vae) or hyperspherical variational (svae) autoencoder.",
    )
    window: int = Field(61, json_schema_extra=OFTEN, description="Frames per window.", ge=4)
    rate_hz: float = Field(120.0, json_schema_extra=OFTEN, description="Frames a second.", gt=0)
    latent: int = Field(100, description="Latent width of the whole body; each part has its share.", ge=5)
    blocks: int = Field(3, description="Blocks of the encoder, and as many of the decoder.", ge=0)
    loss: LossWeights = LossWeights()
    kl_weight: float = Field(0.005, description="Weight of the divergence from the prior, for vae and svae.", ge=0)
    kl_cycles: int = Field(
        4, description="Cycles of the divergence's weight, which rises from 0 in the first half of each.", ge=1
    )
    l1_weight: float = Field(1e-6, description="Weight of the sum of the weights' magnitudes.", ge=0)
    cycle: int = Field(2000, description="Steps in which the learning rate rises to its highest and falls.", ge=2)
    cycle_low: float = Field(0.1, description="Lowest learning rate of a cycle, as a share of its highest.", ge=0)
    cycle_decay: float = Field(0.9, description="Factor of the learning rate from one cycle to the next.", gt=0)
    retarget: bool = Field(True, description="Put clips of other rigs on the rig; otherwise they are left out.")
    # The paper has no gradient limit and no average. A limit would make the parts of a training depend on each other.
    clip_norm: float = Field(1e6, description="Largest gradient norm; larger gradients are scaled down.")
    average: float = Field(0.0, description="Decay of the moving average of the weights; 0 for no average.")
    points: int = Field(0, description="Unused: there are no clouds.", ge=0, le=0)

    @model_validator(mode="after")
    def _part_exists(self) -> Config:
        if self.parts not in DECOMPOSITIONS:
            raise ValueError(f"parts must be one of {', '.join(map(str, DECOMPOSITIONS))}, not {self.parts}")
        if self.part is not None and self.part not in DECOMPOSITIONS[self.parts]:
            raise ValueError(f"part must be one of {', '.join(DECOMPOSITIONS[self.parts])}, not {self.part}")
        return self

    @property
    def trained(self) -> tuple[str, ...]:
        """Names of the parts to train."""
        return tuple(DECOMPOSITIONS[self.parts]) if self.part is None else (self.part,)
