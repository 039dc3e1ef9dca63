"""Settings of `pumps skin`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import OFTEN, SeededConfig, WritingConfig


class Config(WritingConfig, SeededConfig):
    """Put motions on bodies: a mesh sequence for every clip."""

    input: Path = Field(description="A motion artefact, or a recording of any format that pumps reads.")
    output: Path = Field(description="Folder of the mesh artefact.")
    identities: int = Field(
        1, json_schema_extra=OFTEN, description="Bodies to draw; 1 for the neutral adult. A clip gets one.", ge=1
    )
    bodies: Path | None = Field(
        None,
        description="A mesh artefact whose bodies are worn, instead of anny's; --identities takes the first ones.",
    )
    fps: float = Field(25.0, json_schema_extra=OFTEN, description="Frame rate to which clips are resampled.", gt=0)
    root: Literal["removed", "kept"] = Field(
        "removed",
        json_schema_extra=OFTEN,
        description="removed: the pelvis neither moves nor turns (the paper). kept: as recorded.",
    )
    where: str | None = Field(
        None, description="Which clips to use: an expression over the clip index, such as 'seconds > 3'."
    )
    store: Literal["bones", "float32", "float16"] = Field(
        "bones",
        json_schema_extra=OFTEN,
        description="bones: the bones' transforms, from which vertices are computed when they are read. float32 or "
        "float16: every vertex, about 160 or 80 KB a frame; float16 rounds to about 1 mm.",
    )
    body_models: Path | None = Field(
        None,
        description="Folder of SMPL's body models (.npz): the input is then a file, folder or archive of SMPL's, "
        "SMPL-H's or SMPL-X's parameters, and the meshes are these models' surfaces, stored as vertices.",
    )
    shape: Literal["own", "mean"] = Field(
        "own",
        description="With --body-models. own: each recording's own shape and gender. mean: the neutral body with "
        "flat hands (the paper's one identity).",
    )
    splits: Path | None = Field(
        None,
        description="With --body-models: JSON of splits, as for `pumps ingest`; also {split: [data sets]}.",
    )
    licence: str | None = Field(None, description="Licence of a recording, which the artefact then states.")
