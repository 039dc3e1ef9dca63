"""Settings of `pumps train citl`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import OFTEN
from stages.shared.networks.layers.sizes import InterpolatorSizes
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train an interpolator in one skeleton's pose space, on motions of that skeleton (CITL on FOQ, PC-MRL 3.4)."""

    tpc: Path = Field(description="The tpc artefact of the skeleton's motions, its own or adapted ones.")
    network: InterpolatorSizes = InterpolatorSizes()
    rest_pose_m: float = Field(
        0.03,
        json_schema_extra=OFTEN,
        description="Rest-pose augmentation: standard deviation of random offsets of the bones' tails, in metres;"
        " 0 for none.",
        ge=0,
    )
    rotation_weight: float = Field(
        1.0,
        json_schema_extra=OFTEN,
        description="Weight of the rotation error relative to the position error, which is in metres.",
        ge=0,
    )
