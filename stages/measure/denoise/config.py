"""Settings of `pumps measure denoise`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig, WritingConfig
from stages.shared.weights.shipped import default_weights


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure plain filters and networks that clean noisy motion, on held-out clips of one rig: PUMPS Table 4."""

    tpc: Path = Field(description="The tpc artefact with clips of the rig.")
    weights: tuple[str, ...] = Field(
        (),
        description="NAME=FOLDER of a checkpoint: of `pumps train finetune --task denoise` or repair, of "
        "`pumps train denoiser`, or of `pumps train baseline --method` motion-vae or pose-ndf; each is a row of the "
        "table.",
    )
    fill: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights whose autoencoder the denoisers of `pumps train denoiser` were trained with.",
    )
    breakdown: bool = Field(
        False,
        description="Also measure what a perfect denoiser of latents would give (true latents), and the solve alone "
        "(true clouds).",
    )
    skeleton: str | None = Field(None, description="The rig: a BVH; by default that of the first fine-tuned weights.")
    output: Path = Field(description="Folder of the metrics artefact.")
    noise: Literal["paper", "capture", "swapped", "frozen", "lost", "none"] = Field(
        "paper",
        description="Preset of the noise; swapped (left and right limbs exchanged), frozen and lost are single "
        "faults of capture; none measures what cleaning does to clean clips.",
    )
    filters: tuple[str, ...] = Field(
        ("laplacian", "savgol", "one-euro", "butterworth"), description="Plain filters to measure."
    )
    widths: tuple[float, ...] = Field(
        (0.5, 1, 1.5, 2, 3, 4, 6, 8),
        description="Widths that each filter may take: the best on the clips of --tune-on is measured.",
        min_length=1,
    )
    tune_on: str = Field("val", description="Split on which the filters' widths are chosen.")
    tune_windows: int = Field(24, description="Windows of it.", ge=1)
    splits: tuple[str, ...] = Field(("test",), description="Splits to measure.")
    category: tuple[str, ...] = Field(
        (),
        description="NAME=PATTERN: clips whose source matches, such as Walk=*walk*; by default the first word of the "
        "file's name.",
    )
    window: int = Field(128, description="Frames per window, at 30 a second.", ge=8)
    max_windows: int = Field(0, description="Windows per category, spread evenly over the clips; 0 for all.", ge=0)
