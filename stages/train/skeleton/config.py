"""Settings of `pumps train skeleton`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.networks.layers.sizes import EncoderSizes, SkeletonSizes
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train a network from clouds to one rig's motion, on any skeletons' clouds and without pairs (PC-MRL 3.2)."""

    skeleton: str = Field(description="A BVH of the rig: its skeleton, and frames to take its rest pose from.")
    tpc: tuple[Path, ...] = Field(description="The tpc artefacts to learn from; their skeletons may be any.")
    rest_frame: int | None = Field(
        None, description="The rig's frame to take as its rest pose; none: the mean of all."
    )
    encoder: EncoderSizes = EncoderSizes()
    network: SkeletonSizes = SkeletonSizes()
    loss_points: int = Field(
        256,
        description="Points of each cloud that the distance of clouds is taken on; the network sees `points`.",
        ge=8,
    )
    neighbours: int = Field(8, description="K of the distance of clouds.", ge=1)
    knn_weight: float = Field(1.0, description="Weight of the distance of clouds, metres (PC-MRL eq. 5).", ge=0)
    back_weight: float = Field(0.0, description="Weight of the same from the rig's cloud to the source's.", ge=0)
    shape_weight: float = Field(
        0.02, description="Weight of the distance of clouds whose body groups have one place and spread.",
        ge=0,
    )  # fmt: skip
    velocity_weight: float = Field(0.1, description="Weight of the neighbours' difference in velocity, m/s.", ge=0)
    end_weight: float = Field(
        0.2,
        description="Weight of the distance of head, hands and feet, metres (PC-MRL eq. 6); unfolds the arms.",
        ge=0,
    )
    unit_weight: float = Field(0.01, description="Weight of the unit-quaternion loss.", ge=0)
    roll_weight: float = Field(
        0.01, description="Weight that keeps bones' roll, which clouds leave open, near the rest pose.", ge=0
    )
    proportions: float = Field(
        1.25,
        description="With augment, sources' bones grow or shrink by factors of up to this; 1 is off. One build of "
        "source teaches one build.",
        ge=1.0,
        le=2.0,
    )
    size_min: float = Field(0.9, description="Least size that source clouds are scaled to, with augmentation.", gt=0)
    size_max: float = Field(1.1, description="Largest size that source clouds are scaled to.", gt=0)
