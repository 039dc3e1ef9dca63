"""Sizes of the networks, as configs and checkpoints hold them. Imports no torch."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, model_validator

HEADS = ("mlp", "skinning")
POSITIONS = ("rope", "sinusoidal")
DROPOUT_KINDS = ("sequence", "element")
IDENTITIES = ("gaussian", "grid", "vae")
GRID_WIDTH = 2


class Sizes(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class EncoderSizes(Sizes):
    """The frame encoder (PUMPS 3.1): vector attention over k neighbours, farthest-point pooling."""

    width: int = Field(
        default=32, description="Feature width of a point in the first block; doubles with every pooling."
    )
    blocks: int = Field(
        default=4, description="Attention blocks, each followed by farthest-point pooling to a quarter."
    )
    neighbours: int = Field(default=8, description="k of the attention over nearest neighbours.")
    heads: int = Field(
        default=8, description="Channel groups that share one attention weight (grouped vector attention)."
    )


class DecoderSizes(Sizes):
    """The cloud decoder (PUMPS 3.2): RoPE attention over time, noise identities, a point-wise MLP."""

    width: int = Field(default=512, description="Width of the attention over time.")
    layers: int = Field(default=4, description="Layers of attention over time.")
    heads: int = Field(default=8, description="Attention heads.")
    noise: int = Field(default=128, description="Width of a point's noise identity.")
    identities: str = Field(
        default="gaussian",
        description="What tells points apart: gaussian noise (PUMPS), a fixed 2D grid (FoldingNet), or draws from a "
        "Gaussian that the frame gives (vae, as PointIVAE); PUMPS Table 2.",
    )
    head: str = Field(
        default="mlp", description="How a point is made: mlp (PUMPS), or skinning (frame transforms times codes)."
    )
    codes: int = Field(default=64, description="Width of a point's code in the skinning head.")
    point_width: int = Field(default=512, description="First hidden width of the point-wise MLP.")
    point_hidden: int = Field(default=32, description="Second hidden width of the point-wise MLP.")
    dropout: float = Field(default=0.1, description="Share of latent features that sequence-wise dropout leaves out.")
    positions: str = Field(default="rope", description="Positions in time: rope, or sinusoidal (PUMPS Table 2).")
    dropout_kind: str = Field(default="sequence", description="sequence, or element (PUMPS Table 2).")

    @property
    def identity_width(self) -> int:
        """Numbers that make a point's identity."""
        return GRID_WIDTH if self.identities == "grid" else self.noise

    @model_validator(mode="after")
    def _choices_exist(self) -> DecoderSizes:
        for name, choices in (
            ("head", HEADS),
            ("positions", POSITIONS),
            ("dropout_kind", DROPOUT_KINDS),
            ("identities", IDENTITIES),
        ):
            if getattr(self, name) not in choices:
                raise ValueError(f"{name} must be one of {', '.join(choices)}, not {getattr(self, name)!r}")
        if self.identities == "vae" and self.head != "mlp":
            raise ValueError("identities = 'vae' goes with head = 'mlp': its codes change from frame to frame")
        return self


class SynthesiserSizes(Sizes):
    """The latent motion synthesiser (PUMPS 3.3)."""

    width: int = Field(default=512, description="Width of all attention stages.")
    heads: int = Field(default=8, description="Attention heads.")
    key_layers: int = Field(default=8, description="Layers over the keyframes alone.")
    fill_layers: int = Field(default=8, description="Layers in which missing frames look at the encoded keys.")
    frame_layers: int = Field(default=8, description="Layers over all frames.")
    base: str = Field(
        default="skeleton",
        description="What the residual is added to: the latents of the skeleton's own plain "
        "interpolation (skeleton), or the known latents interpolated (latent).",
    )
    glide_root_s: float = Field(
        default=0.0,
        ge=0,
        description="Seconds in which the base's speed decays beyond the keys; 0 holds the pose.",
    )
    glide_turn_s: float = Field(default=0.0, ge=0, description="The same of rotations.")


class SkeletonSizes(Sizes):
    """The network from clouds to one rig's pose (PC-MRL 3.2, 4.2)."""

    width: int = Field(default=256, description="Width of the attention over time.")
    layers: int = Field(default=4, description="Layers of attention over time.")
    heads: int = Field(default=8, description="Attention heads.")
    heading: bool = Field(
        default=True,
        description="Turn every frame's cloud to face one way before the network sees it; without it (PC-MRL) the "
        "network learns all headings.",
    )


class InterpolatorSizes(Sizes):
    """The interpolator in one skeleton's pose space (CITL, as PC-MRL 3.4 changes it)."""

    width: int = Field(default=512, description="Width of all attention stages.")
    heads: int = Field(default=8, description="Attention heads.")
    key_layers: int = Field(default=8, description="Layers over the keyframes alone.")
    fill_layers: int = Field(default=8, description="Layers in which missing frames look at the encoded keys.")
    frame_layers: int = Field(default=8, description="Layers over all frames.")
    longest: int = Field(default=64, description="Frames apart beyond which all distances count alike.", ge=1)
