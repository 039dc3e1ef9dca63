"""Settings of a training of the synthesiser. Imports no torch."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import OFTEN
from stages.shared.networks.layers.sizes import SynthesiserSizes
from stages.shared.training.config import TrainingConfig


class NewSizes(SynthesiserSizes):
    """Sizes of new trainings, whose base moves on beyond the keys. The base of older weights stands still there."""

    # On validation clips (docs/log.md, 2026-11-28): a position keeps its speed for about a second, a rotation does
    # not.
    glide_root_s: float = Field(
        default=0.8,
        ge=0,
        description="Before the first and after the last keyframe: seconds in which the speed of the root decays;"
        " 0 to hold the pose.",
    )
    glide_turn_s: float = Field(default=0.1, ge=0, description="The same for rotations.")


class SynthesiserTrainingConfig(TrainingConfig):
    """A training of the latent motion synthesiser with the frozen encoder."""

    tpc: Path = Field(description="The tpc artefact to learn from; its clips are encoded with newly drawn points.")
    ae: Path = Field(description="Checkpoint artefact of the autoencoder.")
    latent: Path | None = Field(None, description="The latent artefact of the same clips, made by the same encoder.")
    synthesiser: NewSizes = NewSizes()
    even: bool = Field(
        True,
        description="Spread points evenly over the bones, so that latents depend on the pose and hardly on the "
        "random draw.",
    )
    recorded_share: float = Field(
        0.0,
        json_schema_extra=OFTEN,
        description="With --augment: fraction of the windows that keep the recorded speed, size and bones; they "
        "are still mirrored and rotated.",
        ge=0.0,
        le=1.0,
    )
    borrowed_share: float = Field(
        0.0,
        description="With --augment: fraction of the windows in which the arms, or all above the pelvis, move as in "
        "another clip on the same skeleton.",
        ge=0.0,
        le=1.0,
    )
    reuse: int = Field(
        1,
        description="How many steps use each encoded window. Encoding takes more than half the time of a step on "
        "a CPU.",
        ge=1,
        le=16,
    )
    kept_windows: int = Field(
        8192,
        description="With --reuse: how many encoded windows to keep on disk, 0.1 MB each. With few of them, "
        "windows return so soon that the network memorises them.",
        ge=1,
    )
    latent_weight: float = Field(
        0.1, description="Weight of the latent error relative to the error of the decoded clouds."
    )
    longest_gap: int = Field(32, description="Most missing frames in a row, in transitions and predictions.")
