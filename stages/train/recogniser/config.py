"""Settings of `pumps train recogniser`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import OFTEN
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train a recogniser of actions on real motions; its features measure generated ones (FID, accuracy)."""

    concepts: Path = Field(description="The concepts artefact, segmented with --cluster, of one rig at one rate.")
    actions: tuple[str, ...] = Field((), json_schema_extra=OFTEN, description="Actions to tell apart; default: all.")
    window: int = Field(60, json_schema_extra=OFTEN, description="Frames per window.", ge=8)
    batch: int = Field(32, json_schema_extra=OFTEN, description="Windows per step.", ge=1)
    steps: int = Field(1000, json_schema_extra=OFTEN, description="Optimiser steps.", ge=1)
    learning_rate: float = Field(1e-3, json_schema_extra=OFTEN, description="Highest learning rate.")
    width: int = Field(128, description="Width of the recurrent layers.", ge=4)
