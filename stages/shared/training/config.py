"""Settings that every training shares. Imports no torch."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import OFTEN, DeviceConfig, SeededConfig, WritingConfig


class TrainingConfig(WritingConfig, DeviceConfig, SeededConfig):
    """The one training loop's settings."""

    output: Path = Field(description="Folder of the checkpoint artefact.")
    steps: int = Field(10000, json_schema_extra=OFTEN, description="Optimiser steps.", ge=1)
    batch: int = Field(16, json_schema_extra=OFTEN, description="Windows per step.", ge=1)
    accumulate: int = Field(
        1, description="Parts into which each process divides its share of a batch; their gradients are summed.", ge=1
    )
    window: int = Field(128, json_schema_extra=OFTEN, description="Frames per window.", ge=4)
    points: int = Field(256, description="Points per cloud.", ge=8)
    optimiser: Literal["adamw", "muon"] = Field(
        "adamw",
        json_schema_extra=OFTEN,
        description="adamw, or muon: Muon for the matrices of the layers and AdamW for all else, at the same rate.",
    )
    learning_rate: float = Field(1e-4, json_schema_extra=OFTEN, description="Highest learning rate.")
    warmup: int = Field(200, description="Steps of linear warm-up; inverse-square-root decay follows.")
    cooldown: float = Field(
        0.2, description="Fraction of the steps, at the end, in which the learning rate falls to zero."
    )
    weight_decay: float = Field(0.01, description="Weight decay.")
    clip_norm: float = Field(1.0, description="Largest gradient norm; larger gradients are scaled down.")
    average: float = Field(
        0.999, description="Decay of the moving average of the weights, which is what is kept; 0 for no average."
    )
    sigma_min_m: float = Field(
        0.025, description="Smallest standard deviation of the points' offsets from the bones, in metres."
    )
    sigma_max_m: float = Field(
        0.075, description="Largest standard deviation of the points' offsets from the bones, in metres."
    )
    augment: bool = Field(
        True,
        json_schema_extra=OFTEN,
        description="Vary playback speed and size, and mirror left and right, at random for each window.",
    )
    proportions: float = Field(
        1.0,
        description="With --augment, scale bones by random factors up to this one, left and right alike; 1 for none.",
        ge=1.0,
        le=2.0,
    )
    balance: float = Field(
        0.0,
        json_schema_extra=OFTEN,
        description="How often a data set is drawn: in proportion to its frames raised to this power. 0: all "
        "equally often. 1: by their frames.",
    )
    cache_mb: float = Field(
        512, description="Megabytes of frames to keep in memory; other frames are read when they are needed."
    )
    workers: int = Field(
        0,
        json_schema_extra=OFTEN,
        description="Processes that prepare batches (2 to 8 for a GPU); 0 for a thread instead.",
        ge=0,
    )
    activation_checkpointing: bool = Field(
        False, description="Recompute activations in the backward pass: less memory, about a third more time."
    )
    mixed_precision: bool = Field(True, description="Use bfloat16 in the networks if the device computes it faster.")
    validate_every: int = Field(500, json_schema_extra=OFTEN, description="Steps between validations.", ge=1)
    checkpoint_every: int = Field(500, description="Steps between checkpoints.", ge=1)
    keep_checkpoints: int = Field(
        2, description="How many checkpoints of an unfinished run to keep, the newest ones.", ge=1
    )
    keep_optimiser: bool = Field(False, description="Keep the optimiser's state in the finished checkpoint.")
    initial: Path | None = Field(
        None,
        json_schema_extra=OFTEN,
        description="Finished checkpoint to start from: its weights, and its optimiser's state if it has one.",
    )
    patience: int = Field(
        0, description="Stop after this many validations without improvement; 0 to never stop early."
    )
    max_time: float = Field(
        0,
        json_schema_extra=OFTEN,
        description="Stop after this many minutes with a checkpoint from which the same command continues; 0 for "
        "no limit.",
    )
    minutes: float = Field(
        0,
        json_schema_extra=OFTEN,
        description="Finish after this many minutes of training, over all calls, instead of after --steps; the "
        "learning rate falls to zero by then. Two such runs are not identical. 0 to finish after "
        "--steps.",
        ge=0,
    )
    tensorboard: bool = Field(False, description="Also write TensorBoard logs (needs the extra 'tensorboard').")

    @property
    def last_step(self) -> int | None:
        """The step that ends the training; None where minutes end it."""
        return None if self.minutes else self.steps
