"""Settings of `pumps train spectral`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from stages.shared.contract import OFTEN
from stages.shared.networks.layers.sizes import JointMlpSizes, SpectralSizes
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train a network that predicts or completes mesh sequences (SpecTrHuMS), or siMLPe on their joints."""

    mesh: Path = Field(description="The mesh artefact to train on.")
    task: Literal["predict", "complete"] = Field(
        "predict",
        json_schema_extra=OFTEN,
        description="predict what follows the known frames, or complete the frames up to a known last one.",
    )
    method: Literal["spectral", "joints"] = Field(
        "spectral",
        json_schema_extra=OFTEN,
        description="spectral: SpecTrHuMS, on coefficients. joints: siMLPe, on the joints alone, to compare with.",
    )
    eigenvectors: int = Field(512, json_schema_extra=OFTEN, description="Spectral coefficients of a mesh.", ge=4)
    window: int = Field(75, json_schema_extra=OFTEN, description="Frames per window.", ge=4)
    points: int = Field(0, description="Unused: there are no clouds.", ge=0, le=0)
    known: int = Field(50, json_schema_extra=OFTEN, description="First frames of a window that are known.", ge=1)
    stride: int = Field(5, description="Frames between the starts of neighbouring windows.", ge=1)
    static_steps: int = Field(
        500,
        json_schema_extra=OFTEN,
        description="Steps in which the autoencoder trains alone (the paper: two epochs).",
        ge=0,
    )
    keep: Literal["best", "last", "both"] = Field(
        "best",
        json_schema_extra=OFTEN,
        description="Weights to keep: those of the least validation error (early stopped), the last, or both.",
    )
    network: SpectralSizes = SpectralSizes()
    joint_network: JointMlpSizes = JointMlpSizes()
    batch: int = Field(32, json_schema_extra=OFTEN, description="Windows per step.", ge=1)
    weight_decay: float = Field(0.0, description="Weight decay.")
    mixed_precision: bool = Field(False, description="Use bfloat16 in the networks if the device computes it faster.")

    @model_validator(mode="after")
    def _fits(self) -> Config:
        least = self.known + (2 if self.task == "complete" else 1)
        if self.window < least:
            raise ValueError(f"window ({self.window}) must be at least {least} with known = {self.known}")
        if self.method == "joints" and self.task == "complete":
            raise ValueError("siMLPe (method = 'joints') predicts; it does not complete")
        if self.method == "joints" and self.window - self.known > self.known:
            raise ValueError("siMLPe (method = 'joints') predicts at most as many frames as are known")
        if self.workers:
            raise ValueError("workers must be 0: windows of meshes are drawn in a thread")
        return self
