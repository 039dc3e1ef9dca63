"""Settings of `pumps train skeleton`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import OFTEN
from stages.shared.networks.layers.sizes import EncoderSizes, SkeletonSizes
from stages.shared.training.config import TrainingConfig


class Config(TrainingConfig):
    """Train a network from clouds to one rig's motion, on any skeletons' clouds and without pairs (PC-MRL 3.2)."""

    skeleton: str = Field(
        description="BVH of the rig (ARCHIVE.zip!MEMBER too): its skeleton, and the frames for its rest pose."
    )
    tpc: tuple[Path, ...] = Field(description="The tpc artefact to learn from, of any skeletons.")
    rest_frame: int | None = Field(
        None,
        json_schema_extra=OFTEN,
        description="Frame of the BVH to use as the rest pose; by default the mean of all frames.",
    )
    encoder: EncoderSizes = EncoderSizes()
    network: SkeletonSizes = SkeletonSizes()
    loss_points: int = Field(
        256,
        description="Points per cloud that the loss compares; the network sees --points.",
        ge=8,
    )
    neighbours: int = Field(8, description="Number of nearest neighbours in the distance between clouds.", ge=1)
    knn_weight: float = Field(
        1.0, description="Weight of the distance between clouds, in metres (PC-MRL eq. 5).", ge=0
    )
    back_weight: float = Field(
        0.0, description="Weight of the same distance, measured from the rig's cloud to the source's.", ge=0
    )
    shape_weight: float = Field(
        0.02, description="Weight of the distance between clouds whose body groups are moved and scaled to the same "
            "place and spread.",
        ge=0,
    )  # fmt: skip
    velocity_weight: float = Field(
        0.1, description="Weight of the difference in velocity between neighbours, in m/s.", ge=0
    )
    end_weight: float = Field(
        0.2,
        description="Weight of the distance between the heads, hands and feet, in metres (PC-MRL eq. 6); it "
        "prevents folded arms.",
        ge=0,
    )
    unit_weight: float = Field(0.01, description="Weight of the unit-quaternion loss.", ge=0)
    roll_weight: float = Field(
        0.01,
        description="Weight that keeps the bones' roll, which clouds do not determine, near the rest pose.",
        ge=0,
    )
    proportions: float = Field(
        1.25,
        description="With --augment, scale the bones of the sources by random factors up to this one; 1 for none."
        " Without it, sources of one build train the network for that build alone.",
        ge=1.0,
        le=2.0,
    )
    size_min: float = Field(
        0.9, description="With --augment: smallest factor by which source clouds are scaled.", gt=0
    )
    size_max: float = Field(
        1.1, description="With --augment: largest factor by which source clouds are scaled.", gt=0
    )
