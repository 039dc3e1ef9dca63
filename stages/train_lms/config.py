"""Settings of `pumps train lms`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.networks.sizes import SynthesiserSizes
from stages.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train the latent motion synthesiser with the frozen encoder (PUMPS 3.3)."""

    tpc: Path = Field(description="The tpc artefact to learn from (latents are drawn afresh at every step).")
    ae: Path = Field(description="The autoencoder's checkpoint artefact.")
    latent: Path | None = Field(None, description="The latent artefact of these clips; it must be of this encoder.")
    synthesiser: SynthesiserSizes = SynthesiserSizes()
    latent_weight: float = Field(0.1, description="Weight of the latents' error beside the decoded clouds'.")
    longest_gap: int = Field(32, description="Most frames masked in one piece in transitions and predictions.")
