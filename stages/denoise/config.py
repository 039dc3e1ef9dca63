"""Settings of `pumps denoise`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import NAMES_OF, DeviceConfig, MotionFilesConfig, SeededConfig
from stages.shared.weights.shipped import default_weights


class Config(MotionFilesConfig, DeviceConfig, SeededConfig):
    """Clean a noisy motion on its own skeleton: find noisy and missing frames, mend them, keep the others."""

    input: Path = Field(
        description="Motion to clean: a BVH, whose untouched frames keep their bytes, or any format that pumps reads."
        " FILE.zip!MEMBER reads from an archive; of a folder, an archive or a pattern, each file is cleaned."
    )
    output: Path = Field(description="File to write: .bvh, .glb, .npz, .csv or .parquet.")
    method: Literal["mend", "latent", "savgol", "one-euro", "butterworth", "laplacian"] = Field(
        "mend",
        description="mend finds what is noisy and keeps the rest; latent also corrects the result by networks that "
        "need no training on the rig; the others are plain filters of all frames.",
    )
    weights: Path | None = Field(
        None,
        description="A network that is run after mend: one of the rig, from `pumps train finetune --task repair` or "
        "denoise; with --method latent one of all rigs, from `pumps train denoiser`.",
    )
    fill: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights that fill stretches of over 0.3 s in which no frame is usable; none interpolates them. "
        "--method latent also takes their autoencoder, with which the denoiser must have been trained.",
    )
    strength: float = Field(
        1.0, description="0 changes nothing, 1 takes the result as it is. Missing frames are filled in any case.",
        ge=0, le=1,
    )  # fmt: skip
    width: float = Field(
        1.0, description="For the plain filters: factor on the time over which they average.", gt=0, le=20
    )
    frames: str | None = Field(
        None,
        description="Clean only these frames: ranges such as 40:90 (without 90) or numbers such as 3,5,8,"
        " joined by commas.",
    )
    joints: str | None = Field(
        None, description="Clean these joints alone: names joined by commas; root is the position."
    )
    mask: Path | None = Field(
        None,
        description="CSV of what is missing: one row a frame, 1 for missing and 0 for there. Without a header line, "
        "one column is for the whole frame; a header line names a joint for each column.",
    )
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one.", gt=0, lt=1e6
    )
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body (`pumps inspect FILE --map` prints one)."
    )
