"""Settings of `pumps train denoiser`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import NAMES_OF, OFTEN
from stages.shared.training.config import TrainingConfig
from stages.shared.weights.shipped import default_weights


class Config(TrainingConfig):
    """Train a denoiser of latents for all rigs at once, from the synthesiser of trained weights."""

    learning_rate: float = Field(4e-4, json_schema_extra=OFTEN, description="Highest learning rate.")
    window: int = Field(96, json_schema_extra=OFTEN, description="Frames per window.", ge=8)
    batch: int = Field(8, json_schema_extra=OFTEN, description="Windows per step.", ge=1)
    tpc: Path = Field(description="The tpc artefact with motions of any rigs.")
    from_: str = Field(
        default_factory=default_weights,
        json_schema_extra={**OFTEN, NAMES_OF: "weights"},
        description="Weights whose autoencoder makes the latents, and whose synthesiser training starts from.",
    )
    noises: tuple[Literal["paper", "capture", "none"], ...] = Field(
        ("paper", "capture", "none"),
        json_schema_extra=OFTEN,
        description="Presets of the noise; each window gets one of them, at random.",
        min_length=1,
    )
    start: Literal["mended", "noisy"] = Field(
        "mended",
        description="The motion whose latents are corrected: the noisy one after mending, or the noisy one itself.",
    )
    latent_weight: float = Field(
        0.1, description="Weight of the latent error relative to the error of the decoded clouds.", ge=0
    )
