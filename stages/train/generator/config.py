"""Settings of `pumps train generator`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import OFTEN
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train a network that generates motions of an action, on real motions of one rig."""

    concepts: Path = Field(description="The concepts artefact, segmented with --cluster, of one rig at one rate.")
    network: Literal["actor", "recurrent"] = Field(
        "actor",
        json_schema_extra=OFTEN,
        description="actor: a transformer VAE with one code for a motion (ACTOR). recurrent: a recurrent VAE with a "
        "code for each frame (Action2Motion).",
    )
    actions: tuple[str, ...] = Field((), json_schema_extra=OFTEN, description="Actions to learn; default: all.")
    window: int = Field(60, json_schema_extra=OFTEN, description="Frames per window.", ge=8)
    batch: int = Field(32, json_schema_extra=OFTEN, description="Windows per step.", ge=1)
    steps: int = Field(3000, json_schema_extra=OFTEN, description="Optimiser steps.", ge=1)
    learning_rate: float = Field(5e-4, json_schema_extra=OFTEN, description="Highest learning rate.")
    width: int = Field(128, description="Width of the layers, a multiple of 4.", ge=4, multiple_of=4)
    blocks: int = Field(2, description="Transformer blocks of encoder and decoder, or recurrent layers.", ge=1)
    latent: int = Field(32, description="Width of a motion's code (actor), or of a frame's (recurrent).", ge=1)
    kl_weight: float = Field(1e-3, description="Weight of the KL divergence in the loss.", ge=0)
