"""Settings of `pumps train baseline`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from stages.shared.contract import OFTEN, OFTEN_SET, VALUES
from stages.shared.networks.inbetween.methods import METHODS, method_names
from stages.shared.networks.layers.sizes import MethodSizes
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train another method of filling on one skeleton's own motions, as a row of PUMPS Table 1."""

    tpc: Path = Field(description="The tpc artefact of the skeleton's motions.")
    method: str = Field(
        json_schema_extra={VALUES: list(METHODS), OFTEN_SET: True},
        description=f"The method: {', '.join(METHODS)}, or one of an installed package (docs/benchmark.md).",
    )
    network: MethodSizes = MethodSizes()
    learning_rate: float = Field(
        0.0, json_schema_extra=OFTEN, description="Highest learning rate; 0 for that of the method's paper.", ge=0
    )
    longest_gap: int = Field(64, description="Longest gap of the transitions in training, frames.", ge=10)
    mixed_precision: bool = Field(False, description="Use bfloat16 in the networks if the device computes it faster.")

    @field_validator("method")
    @classmethod
    def _method_exists(cls, value: str) -> str:
        if value not in method_names():
            raise ValueError(f"must be one of {', '.join(method_names())}, not {value}")
        return value
