"""Settings of `pumps train citl`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.networks.layers.sizes import InterpolatorSizes
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train an interpolator in one skeleton's pose space, on motions of that skeleton (CITL on FOQ, PC-MRL 3.4)."""

    tpc: Path = Field(description="The tpc artefact of the skeleton's motions, its own or adapted ones.")
    network: InterpolatorSizes = InterpolatorSizes()
    rest_pose_m: float = Field(
        0.03,
        description="Rest-pose augmentation: standard deviation of the random offsets of bones' tails, metres; 0 for "
        "none.",
        ge=0,
    )
    rotation_weight: float = Field(
        1.0, description="Weight of the rotations' error beside the positions', metres.", ge=0
    )
