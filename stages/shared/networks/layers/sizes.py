"""Sizes of the networks, for configs and checkpoints. Imports no torch."""

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
    neighbours: int = Field(default=8, description="Number of nearest neighbours that attention looks at.")
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
        description="How points are distinguished (PUMPS Table 2): gaussian noise (PUMPS), grid, which is fixed and "
        "2D (FoldingNet), or vae, draws from a Gaussian that depends on the frame (PointIVAE).",
    )
    head: str = Field(
        default="mlp",
        description="How a point is computed: mlp (PUMPS), or skinning (transforms of the frame times codes).",
    )
    codes: int = Field(default=64, description="Width of a point's code in the skinning head.")
    point_width: int = Field(default=512, description="First hidden width of the point-wise MLP.")
    point_hidden: int = Field(default=32, description="Second hidden width of the point-wise MLP.")
    dropout: float = Field(default=0.1, description="Fraction of the latent features that dropout removes.")
    positions: str = Field(default="rope", description="How time is encoded: rope, or sinusoidal (PUMPS Table 2).")
    dropout_kind: str = Field(
        default="sequence",
        description="What dropout removes: features of a whole sequence, or of an element (PUMPS Table 2).",
    )

    @property
    def identity_width(self) -> int:
        """Number of values in a point's identity."""
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
    key_layers: int = Field(default=8, description="Layers over the keyframes only.")
    fill_layers: int = Field(default=8, description="Layers in which missing frames attend to the encoded keyframes.")
    frame_layers: int = Field(default=8, description="Layers over all frames.")
    base: str = Field(
        default="skeleton",
        description="What the predicted difference is added to: skeleton, the latents of a plain interpolation of "
        "the poses, or latent, the interpolated latents.",
    )
    glide_root_s: float = Field(
        default=0.0,
        ge=0,
        description="Before the first and after the last keyframe: seconds in which the speed of the root decays; "
        "0 to hold the pose.",
    )
    glide_turn_s: float = Field(default=0.0, ge=0, description="The same for rotations.")


class SkeletonSizes(Sizes):
    """The network from clouds to one rig's pose (PC-MRL 3.2, 4.2)."""

    width: int = Field(default=256, description="Width of the attention over time.")
    layers: int = Field(default=4, description="Layers of attention over time.")
    heads: int = Field(default=8, description="Attention heads.")
    heading: bool = Field(
        default=True,
        description="Rotate the cloud of each frame to the same heading before the network; without it (PC-MRL) the "
        "network learns all headings.",
    )


class InterpolatorSizes(Sizes):
    """The interpolator in one skeleton's pose space (CITL, as PC-MRL 3.4 changes it)."""

    width: int = Field(default=512, description="Width of all attention stages.")
    heads: int = Field(default=8, description="Attention heads.")
    key_layers: int = Field(default=8, description="Layers over the keyframes only.")
    fill_layers: int = Field(default=8, description="Layers in which missing frames attend to the encoded keyframes.")
    frame_layers: int = Field(default=8, description="Layers over all frames.")
    longest: int = Field(
        default=64,
        description="Largest distance in frames that attention distinguishes; longer ones are treated as this one.",
        ge=1,
    )


class MethodSizes(Sizes):
    """A method that fills one skeleton's poses (`networks/inbetween`); 0 stands for the method's paper's number."""

    width: int = Field(default=0, ge=0, description="Width of the layers; 0 for the paper's.")
    layers: int = Field(default=0, ge=0, description="Layers of each part; 0 for the paper's.")
    heads: int = Field(default=0, ge=0, description="Attention heads; 0 for the paper's.")

    def over(self, paper: MethodSizes) -> MethodSizes:
        """These sizes, with the paper's for those that are 0."""
        return MethodSizes(**{name: value or getattr(paper, name) for name, value in self.model_dump().items()})


class SpectralSizes(Sizes):
    """The spectral autoencoder and the motion transformer (SpecTrHuMS 4.4; channels and pooling: SAE-LP)."""

    channels: tuple[int, ...] = Field(
        default=(32, 64, 128),
        description="Channels of the autoencoder's layers. The paper states three layers and not their channels.",
    )
    pooling: int = Field(default=4, ge=2, description="Factor by which a layer shortens the list of coefficients.")
    convolution: int = Field(default=3, ge=1, description="Coefficients that a convolution sees; odd.")
    latent: int = Field(default=256, ge=4, description="Width of a frame's latent, and of the transformer.")
    heads: int = Field(default=4, ge=1, description="Attention heads.")
    layers: int = Field(default=6, ge=1, description="Layers of the transformer.")
    feedforward: int = Field(default=1024, ge=4, description="Hidden width of the transformer's feed-forward parts.")
    dropout: float = Field(default=0.1, ge=0, lt=1, description="Dropout of the transformer.")

    @model_validator(mode="after")
    def _fits(self) -> SpectralSizes:
        if self.latent % self.heads:
            raise ValueError(f"latent ({self.latent}) must be a multiple of heads ({self.heads})")
        if not self.channels or self.convolution % 2 == 0:
            raise ValueError("channels must name at least one layer, and convolution must be odd")
        return self


class JointMlpSizes(Sizes):
    """siMLPe: fully connected layers over time, on the discrete cosine transform of joints."""

    blocks: int = Field(default=48, ge=1, description="Blocks, each a layer over time and a layer norm.")
