"""Settings that every training shares, and the sizes of the networks. Imports no torch."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from stages.config import DeviceConfig


class _Sizes(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class EncoderSizes(_Sizes):
    """The frame encoder (PUMPS 3.1): vector attention over k neighbours, farthest-point pooling."""

    width: int = Field(32, description="Feature width of a point in the first block; doubles with every pooling.")
    blocks: int = Field(4, description="Attention blocks, each followed by farthest-point pooling to a quarter.")
    neighbours: int = Field(8, description="k of the attention over nearest neighbours.")
    heads: int = Field(8, description="Channel groups that share one attention weight (grouped vector attention).")


class DecoderSizes(_Sizes):
    """The cloud decoder (PUMPS 3.2): RoPE attention over time, noise identities, a point-wise MLP."""

    width: int = Field(512, description="Width of the attention over time.")
    layers: int = Field(4, description="Layers of attention over time.")
    heads: int = Field(8, description="Attention heads.")
    noise: int = Field(128, description="Width of a point's noise identity.")
    point_width: int = Field(512, description="First hidden width of the point-wise MLP.")
    point_hidden: int = Field(32, description="Second hidden width of the point-wise MLP.")
    dropout: float = Field(0.1, description="Share of latent features that sequence-wise dropout leaves out.")
    positions: str = Field("rope", description="Positions in time: rope, or sinusoidal (PUMPS Table 2).")
    dropout_kind: str = Field("sequence", description="sequence, or element (PUMPS Table 2).")


class SynthesiserSizes(_Sizes):
    """The latent motion synthesiser (PUMPS 3.3)."""

    width: int = Field(512, description="Width of all attention stages.")
    heads: int = Field(8, description="Attention heads.")
    key_layers: int = Field(8, description="Layers over the keyframes alone.")
    fill_layers: int = Field(8, description="Layers in which missing frames look at the encoded keys.")
    frame_layers: int = Field(8, description="Layers over all frames.")
    base: str = Field("skeleton", description="What the residual is added to: the latents of the skeleton's own plain "
                      "interpolation (skeleton), or the known latents interpolated (latent).")


class TrainingConfig(DeviceConfig):
    """The one training loop's settings."""

    steps: int = Field(10000, description="Optimiser steps.", ge=1)
    batch: int = Field(16, description="Windows in a step.", ge=1)
    window: int = Field(128, description="Frames in a window.", ge=4)
    points: int = Field(256, description="Points in a cloud.", ge=8)
    learning_rate: float = Field(1e-4, description="Peak learning rate of AdamW.")
    warmup: int = Field(200, description="Steps of linear warm-up; inverse-square-root decay after them.")
    cooldown: float = Field(0.2, description="Share of the steps over which the rate falls to zero at the end.")
    weight_decay: float = Field(0.01, description="AdamW's weight decay.")
    clip_norm: float = Field(1.0, description="Largest gradient norm.")
    average: float = Field(0.999, description="Decay of the moving average of the weights that is kept; 0 for none.")
    sigma_min_m: float = Field(0.025, description="Least standard deviation of the points' offsets, metres.")
    sigma_max_m: float = Field(0.075, description="Largest standard deviation of the points' offsets, metres.")
    augment: bool = Field(True, description="Playback speed, size and left-right mirror, drawn afresh for each window.")
    mixed_precision: bool = Field(True, description="bfloat16 in the networks where the device computes it faster.")
    validate_every: int = Field(500, description="Steps between validations.")
    checkpoint_every: int = Field(500, description="Steps between checkpoints.")
    patience: int = Field(0, description="Validations without gain before stopping early; 0 never stops early.")
    max_time: float = Field(0, description="Minutes after which to stop with a checkpoint that resumes; 0 for none.")
    tensorboard: bool = Field(False, description="Also write TensorBoard logs (needs the extra 'tensorboard').")
