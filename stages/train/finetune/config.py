"""Settings of `pumps train finetune`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import NAMES_OF, OFTEN
from stages.shared.networks.layers.sizes import SynthesiserSizes
from stages.shared.training.config import TrainingConfig
from stages.shared.weights.shipped import default_weights

SCRATCH = "scratch"


class Config(TrainingConfig):
    """Fine-tune the synthesiser for a task in one rig's pose space: denoise, or another (PUMPS 5)."""

    learning_rate: float = Field(5e-4, json_schema_extra=OFTEN, description="Highest learning rate.")
    task: str = Field(
        json_schema_extra=OFTEN,
        description="What to learn: denoise, repair, estimate, trackers, or a task of an installed package.",
    )
    skeleton: str = Field(
        description="The rig: a BVH with at least one frame. FILE.zip!MEMBER reads from an archive."
    )
    tpc: Path = Field(description="The tpc artefact with motions of the rig.")
    from_: str = Field(
        default_factory=default_weights,
        json_schema_extra={**OFTEN, NAMES_OF: "weights"},
        description="Weights to start from, by name or folder, or scratch for none.",
    )
    network: str = Field(
        "pumps",
        description="Kind of network: pumps; or, to compare with, from scratch: transformer or u-vit; for estimate "
        "also poseformer, mixste, mhformer or motionbert.",
    )
    corruption: str | None = Field(
        None,
        json_schema_extra=OFTEN,
        description="How inputs are made worse than the truth: a preset of the task, such as paper or capture; by "
        "default its first.",
    )
    synthesiser: SynthesiserSizes = Field(
        SynthesiserSizes(width=192, heads=6, key_layers=1, fill_layers=2, frame_layers=3),
        description="Sizes for --from scratch; otherwise those of the weights.",
    )
    latent_width: int = Field(192, description="Latent width for --from scratch.", ge=4)
    balance: float = Field(0.0, description="As in `pumps train lms`; clips of one rig are often of one data set.")
    workers: int = Field(0, description="Processes that prepare batches; 0 for a thread instead.", ge=0)
    rest_frame: int | None = Field(
        None, description="Frame of the rig's file that is its rest pose; default: a mean."
    )
    position_weight: float = Field(1.0, description="Weight of the joints' position error, in metres.", ge=0)
    quaternion_weight: float = Field(0.5, description="Weight of the quaternions' error.", ge=0)
