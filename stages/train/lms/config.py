"""Settings of `pumps train lms`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.networks.layers.sizes import SynthesiserSizes
from stages.shared.training.config import TrainingConfig


class NewSizes(SynthesiserSizes):
    """Sizes of new trainings: beyond the keys their base moves on. Weights trained before hold it."""

    # On validation clips (docs/log.md, 2026-11-28): a place keeps its speed for about a second, a turn does not.
    glide_root_s: float = Field(
        default=0.8, ge=0, description="Seconds in which the base's speed decays beyond the keys; 0 holds the pose."
    )
    glide_turn_s: float = Field(default=0.1, ge=0, description="The same of rotations.")


class Config(TrainingConfig):
    """Train the latent motion synthesiser with the frozen encoder (PUMPS 3.3)."""

    tpc: Path = Field(description="The tpc artefact to learn from; latents are encoded from points drawn afresh.")
    ae: Path = Field(description="The autoencoder's checkpoint artefact.")
    latent: Path | None = Field(None, description="The latent artefact of these clips; it must be of this encoder.")
    synthesiser: NewSizes = NewSizes()
    even: bool = Field(
        True, description="Spread points evenly over the bones: latents then hang on the pose, hardly on the draw."
    )
    recorded_share: float = Field(
        0.0,
        description="With augment, share of the windows that keep the speed, size and bones they were recorded with; "
        "they are mirrored and turned all the same.",
        ge=0.0,
        le=1.0,
    )
    reuse: int = Field(
        1,
        description="Steps that a window, once encoded, serves in: encoding costs more than half a step on a CPU.",
        ge=1,
        le=16,
    )
    kept_windows: int = Field(
        8192,
        description="With reuse, encoded windows kept on the disk to learn from again, 0.1 MB each: many, since one "
        "that comes back soon is known by heart.",
        ge=1,
    )
    latent_weight: float = Field(0.1, description="Weight of the latents' error beside the decoded clouds'.")
    longest_gap: int = Field(32, description="Most frames masked in one piece in transitions and predictions.")
