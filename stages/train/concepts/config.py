"""Settings of `pumps train concepts`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import OFTEN
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Learn motion concepts, and the networks that find and mend flawed frames with them, from real motions."""

    concepts: Path = Field(description="The concepts artefact, segmented with --cluster, of one rig at one rate.")
    actions: tuple[str, ...] = Field((), json_schema_extra=OFTEN, description="Actions to learn; default: all.")
    method: Literal["splines", "frames", "reconstruction"] = Field(
        "splines",
        json_schema_extra=OFTEN,
        description="What motions are refined by: concepts whose transitions are splines; concepts whose transitions "
        "are frames that a network fits directly; or a network that reconstructs whole motions, without concepts.",
    )
    window: int = Field(60, json_schema_extra=OFTEN, description="Frames per window.", ge=8)
    batch: int = Field(32, json_schema_extra=OFTEN, description="Windows per step.", ge=1)
    steps: int = Field(3000, json_schema_extra=OFTEN, description="Optimiser steps.", ge=1)
    learning_rate: float = Field(5e-4, json_schema_extra=OFTEN, description="Highest learning rate.")
    width: int = Field(128, description="Width of the motion encoders, a multiple of 4.", ge=4, multiple_of=4)
    latent: int = Field(32, description="Width of the transition generator's code.", ge=1)
    anchor_weight: float = Field(
        0.5, description="Weight of the last anchor in the generator's loss (lambda_A).", ge=0
    )
    kl_weight: float = Field(
        1e-4, description="Weight of the KL divergence in the generator's loss (lambda_KL).", ge=0
    )
    spline_weight: float = Field(1.0, description="Weight of the spline in transition refinement (lambda_C).", ge=0)
    flawed_share: float = Field(
        0.05, description="Share of the training anchors that the quality score would call flawed.", gt=0, lt=1
    )
