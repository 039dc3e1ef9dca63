"""The kinds of artefact, their current versions and their contents."""

from __future__ import annotations

from typing import NamedTuple


class Kind(NamedTuple):
    """One kind of artefact."""

    schema_version: int
    what: str


KINDS: dict[str, Kind] = {
    "motion": Kind(3, "motions on their skeletons: motions.h5 and the index clips.parquet"),
    "tpc": Kind(3, "temporal point clouds, rigid, packed or dense: clouds.h5 and the index clips.parquet"),
    "latent": Kind(2, "one latent and one centroid for every frame: latents.h5 and the index clips.parquet"),
    "mesh": Kind(1, "sequences of meshes of one connectivity, as bones or as vertices: meshes.h5 and clips.parquet"),
    "checkpoint": Kind(2, "a trained network: model.safetensors, config.json, log.parquet, MODEL_CARD.md"),
    "concepts": Kind(1, "motions as anchors and splines between them: concepts.h5 and the index clips.parquet"),
    "metrics": Kind(
        3, "an evaluation: metrics.parquet, one row per clip, method, task and metric; summary.md; perhaps fills.h5"
    ),
}
