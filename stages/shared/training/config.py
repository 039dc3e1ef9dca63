"""Settings that every training shares. Imports no torch."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class TrainingConfig(WritingConfig, DeviceConfig, SeededConfig):
    """The one training loop's settings."""

    output: Path = Field(description="Folder of the checkpoint artefact.")
    steps: int = Field(10000, description="Optimiser steps.", ge=1)
    batch: int = Field(16, description="Windows in a step.", ge=1)
    accumulate: int = Field(
        1, description="Number of parts of a process's share of a batch; gradients are summed over them.", ge=1
    )
    window: int = Field(128, description="Frames in a window.", ge=4)
    points: int = Field(256, description="Points in a cloud.", ge=8)
    optimiser: Literal["adamw", "muon"] = Field(
        "adamw", description="adamw, or muon: Muon for the layers' matrices and AdamW for the rest, at the same rate."
    )
    learning_rate: float = Field(1e-4, description="Peak learning rate.")
    warmup: int = Field(200, description="Steps of linear warm-up, followed by inverse-square-root decay.")
    cooldown: float = Field(0.2, description="Share of the steps over which the rate falls to zero at the end.")
    weight_decay: float = Field(0.01, description="Weight decay.")
    clip_norm: float = Field(1.0, description="Largest gradient norm.")
    average: float = Field(0.999, description="Decay of the moving average of the weights that is kept; 0 for none.")
    sigma_min_m: float = Field(0.025, description="Least standard deviation of the points' offsets, metres.")
    sigma_max_m: float = Field(0.075, description="Largest standard deviation of the points' offsets, metres.")
    augment: bool = Field(
        True, description="Vary playback speed, size and left-right mirroring at random for each window."
    )
    proportions: float = Field(
        1.0,
        description="With augment, scale bones by random factors of up to this, left and right equally; 1 is off.",
        ge=1.0,
        le=2.0,
    )
    balance: float = Field(
        0.0,
        description="A data set's share is proportional to its frames to this power: 0 equal shares, 1 by frames.",
    )
    cache_mb: float = Field(512, description="Megabytes of frames to keep in memory; the rest is read on demand.")
    workers: int = Field(
        0, description="Processes that draw batches ahead (2 to 8 for a GPU); 0 draws in a thread.", ge=0
    )
    activation_checkpointing: bool = Field(
        False, description="Recompute layers in the backward pass: less memory, about a third more time."
    )
    mixed_precision: bool = Field(True, description="Use bfloat16 in the networks if the device computes it faster.")
    validate_every: int = Field(500, description="Steps between validations.", ge=1)
    checkpoint_every: int = Field(500, description="Steps between checkpoints.", ge=1)
    keep_checkpoints: int = Field(2, description="Number of newest checkpoints to keep of an unfinished run.", ge=1)
    keep_optimiser: bool = Field(False, description="Keep the optimiser's state in the finished checkpoint.")
    initial: Path | None = Field(
        None, description="A finished checkpoint to start from: its weights, and its optimiser's state if kept."
    )
    patience: int = Field(
        0, description="Validations without improvement before stopping early; 0 never stops early."
    )
    max_time: float = Field(
        0, description="Minutes after which to stop with a checkpoint from which the run can continue; 0 for none."
    )
    minutes: float = Field(
        0,
        description="Finish after this many minutes of training, over all calls, instead of after the steps; the "
        "learning rate falls to zero by then, so two runs are not identical. 0: finish after the steps.",
        ge=0,
    )
    tensorboard: bool = Field(False, description="Also write TensorBoard logs (needs the extra 'tensorboard').")
