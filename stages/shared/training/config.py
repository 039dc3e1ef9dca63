"""Settings that every training shares. Imports no torch."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import DeviceConfig


class TrainingConfig(DeviceConfig):
    """The one training loop's settings."""

    output: Path = Field(description="Folder of the checkpoint artefact.")
    steps: int = Field(10000, description="Optimiser steps.", ge=1)
    batch: int = Field(16, description="Windows in a step.", ge=1)
    accumulate: int = Field(
        1, description="Parts that each process takes its share of a batch in, one after the other.", ge=1
    )
    window: int = Field(128, description="Frames in a window.", ge=4)
    points: int = Field(256, description="Points in a cloud.", ge=8)
    optimiser: Literal["adamw", "muon"] = Field(
        "adamw", description="adamw, or muon: Muon for the layers' matrices and AdamW for the rest, at the same rate."
    )
    learning_rate: float = Field(1e-4, description="Peak learning rate.")
    warmup: int = Field(200, description="Steps of linear warm-up; inverse-square-root decay after them.")
    cooldown: float = Field(0.2, description="Share of the steps over which the rate falls to zero at the end.")
    weight_decay: float = Field(0.01, description="Weight decay.")
    clip_norm: float = Field(1.0, description="Largest gradient norm.")
    average: float = Field(0.999, description="Decay of the moving average of the weights that is kept; 0 for none.")
    sigma_min_m: float = Field(0.025, description="Least standard deviation of the points' offsets, metres.")
    sigma_max_m: float = Field(0.075, description="Largest standard deviation of the points' offsets, metres.")
    augment: bool = Field(
        True, description="Playback speed, size and left-right mirror, drawn afresh for each window."
    )
    proportions: float = Field(
        1.0,
        description="With augment, bones grow or shrink by factors of up to this, left and right alike; 1 is off.",
        ge=1.0,
        le=2.0,
    )
    balance: float = Field(
        0.0, description="A data set is drawn by its frames to this power: 0 an equal share each, 1 as they come."
    )
    cache_mb: float = Field(512, description="Megabytes of frames to keep in memory; the rest is read when wanted.")
    workers: int = Field(
        0, description="Processes that draw batches ahead (GPUs want 2 to 8); 0: a thread of this one.", ge=0
    )
    activation_checkpointing: bool = Field(
        False, description="Compute layers again in the backward pass: less memory, about a third more time."
    )
    mixed_precision: bool = Field(True, description="bfloat16 in the networks where the device computes it faster.")
    validate_every: int = Field(500, description="Steps between validations.", ge=1)
    checkpoint_every: int = Field(500, description="Steps between checkpoints.", ge=1)
    keep_checkpoints: int = Field(2, description="Checkpoints of an unfinished run to keep, the newest.", ge=1)
    keep_optimiser: bool = Field(False, description="Keep the optimiser's state in the finished checkpoint.")
    initial: Path | None = Field(
        None, description="A finished checkpoint to start from: its weights, and its optimiser's state where kept."
    )
    patience: int = Field(0, description="Validations without gain before stopping early; 0 never stops early.")
    max_time: float = Field(0, description="Minutes after which to stop with a checkpoint that resumes; 0 for none.")
    minutes: float = Field(
        0,
        description="Finish after so many minutes of training, over all calls, whatever the steps: the rate falls to "
        "zero towards them, so that two runs are not the same. 0: steps alone decide.",
        ge=0,
    )
    tensorboard: bool = Field(False, description="Also write TensorBoard logs (needs the extra 'tensorboard').")
