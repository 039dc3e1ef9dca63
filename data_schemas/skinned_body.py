"""Bodies and meshes as records: a connectivity with its joints, and bodies whose vertices follow bones.

N vertices, F triangles, J bones, W bones per vertex, K joints; right-handed, Y up, metres, quaternions xyzw.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

_FRAMES_AT_ONCE = 16  # 13,700 vertices in 16 frames are 10 MB of blended transforms


@dataclass(frozen=True)
class JointRegressor:
    """Joints as weighted means of vertices: K joints, each the sum of weight * vertex over its rows.

    names: K names. rows, vertices: (E,) int32 which joint and which vertex. weights: (E,) float32.
    """

    names: tuple[str, ...] = ()
    rows: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    vertices: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    weights: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))

    def matrix(self, count: int) -> np.ndarray:
        """The regressor as a matrix (K, N) float32, for meshes of `count` vertices."""
        dense = np.zeros((len(self.names), count), np.float32)
        np.add.at(dense, (self.rows, self.vertices), self.weights)
        return dense


@dataclass(frozen=True)
class Skin:
    """Which bones move which vertices: linear blend skinning.

    names, parents: J bones, parents before children, -1 for bone 0.
    bones, weights: (N, W) int16 and float32; weights of a vertex sum to 1, unused places have weight 0.
    """

    names: tuple[str, ...]
    parents: np.ndarray
    bones: np.ndarray
    weights: np.ndarray

    @cached_property
    def dense(self) -> np.ndarray:
        """The weights as a matrix (N, J) float32."""
        matrix = np.zeros((len(self.bones), len(self.names)), np.float32)
        np.add.at(matrix, (np.arange(len(self.bones))[:, None], self.bones), self.weights)
        return matrix


@dataclass(frozen=True)
class Body:
    """One identity at rest, where every bone's rotation is the identity.

    vertices: (N, 3) float32 metres. heads: (J, 3) float64 metres, the bones' heads.
    shape:    what makes the identity, such as {"age": 0.5}; empty if unknown.
    """

    vertices: np.ndarray
    heads: np.ndarray
    shape: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Topology:
    """What all meshes of one artefact share.

    faces: (F, 3) int32 triangles. count: N. joints: the regressor of its joints. skin: None for meshes without bones.
    """

    faces: np.ndarray
    count: int
    joints: JointRegressor = field(default_factory=JointRegressor)
    skin: Skin | None = None


def bone_matrices(body: Body, rotations: np.ndarray, heads: np.ndarray) -> np.ndarray:
    """(T, J, 3, 4) float32: what each bone does to points [x, y, z, 1] of the rest pose.

    Args:
        rotations: (T, J, 4) global, xyzw. heads: (T, J, 3) metres.
    """
    x, y, z, w = np.moveaxis(np.asarray(rotations, np.float64), -1, 0)
    turns = np.stack(
        [
            1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
            2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
            2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
        ],
        axis=-1,
    ).reshape(*x.shape, 3, 3)  # fmt: skip
    moved = np.asarray(heads, np.float64) - np.einsum("tjab,jb->tja", turns, body.heads)
    return np.concatenate([turns, moved[..., None]], axis=-1).astype(np.float32)


def skinned_vertices(skin: Skin, body: Body, rotations: np.ndarray, heads: np.ndarray) -> np.ndarray:
    """The body's vertices (T, N, 3) float32 metres in T poses, by linear blend skinning.

    Args:
        rotations: (T, J, 4) global, xyzw. heads: (T, J, 3) metres.
    """
    frames, count = len(rotations), len(body.vertices)
    matrices = bone_matrices(body, rotations, heads)
    made = np.empty((frames, count, 3), np.float32)
    weights = skin.dense
    for start in range(0, frames, _FRAMES_AT_ONCE):
        some = matrices[start : start + _FRAMES_AT_ONCE]
        blended = (weights @ some.transpose(1, 0, 2, 3).reshape(weights.shape[1], -1)).reshape(count, len(some), 3, 4)
        turned = np.einsum("ntab,nb->tna", blended[..., :3], body.vertices, optimize=True)
        made[start : start + _FRAMES_AT_ONCE] = turned + blended[..., 3].transpose(1, 0, 2)
    return made


def mapped_skin(skin: Skin, body: Body, mapping: np.ndarray) -> np.ndarray:
    """What a linear map of vertices needs of a skinned body: (J, M, 4) float32.

    For a map M of vertices (M, N), `np.einsum("tjab,jmb->tma", bone_matrices(...), mapped_skin(...))` is M times the
    vertices, without the vertices: skinning is linear in the bones' transforms.
    """
    points = np.concatenate([body.vertices, np.ones((len(body.vertices), 1), np.float32)], axis=1)
    weights = skin.dense
    mapping = np.asarray(mapping, np.float32)
    return np.stack([mapping @ (weights[:, [bone]] * points) for bone in range(weights.shape[1])])


def fault_of_topology(topology: Topology) -> str | None:
    """The fault of a topology's arrays, as the end of a sentence; None if they are consistent."""
    faces, count, joints, skin = topology.faces, topology.count, topology.joints, topology.skin
    if count < 1 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        return "has no triangles"
    if faces.min() < 0 or faces.max() >= count:
        return f"has a triangle with a vertex outside 0 to {count - 1}"
    if (faces[:, 0] == faces[:, 1]).any() or (faces[:, 1] == faces[:, 2]).any() or (faces[:, 2] == faces[:, 0]).any():
        return "has a triangle that names a vertex twice"
    entries = (joints.rows, joints.vertices, joints.weights)
    if len({each.shape for each in entries}) != 1 or joints.rows.ndim != 1:
        return "has a joint regressor whose arrays differ in length"
    if len(joints.rows) and (
        joints.rows.min() < 0 or joints.rows.max() >= len(joints.names)
        or joints.vertices.min() < 0 or joints.vertices.max() >= count
        or not np.isfinite(joints.weights).all()
    ):  # fmt: skip
        return "has a joint regressor that names a joint or vertex that is not there, or is not finite"
    return None if skin is None else _fault_of_skin(skin, count)


def _fault_of_skin(skin: Skin, count: int) -> str | None:
    bones = len(skin.names)
    if skin.parents.shape != (bones,) or not bones or skin.parents[0] != -1:
        return "has bones whose first is not the root"
    if (skin.parents[1:] < 0).any() or (skin.parents >= np.arange(bones)).any():
        return "has a bone that does not come after its parent, or two roots"
    if skin.bones.shape != skin.weights.shape or skin.bones.ndim != 2 or len(skin.bones) != count:
        return f"has a skin of the shapes {skin.bones.shape} and {skin.weights.shape}, expected {count} rows in both"
    if skin.bones.min() < 0 or skin.bones.max() >= bones:
        return f"has a vertex on a bone outside 0 to {bones - 1}"
    if not np.isfinite(skin.weights).all() or (skin.weights < 0).any():
        return "has skinning weights that are negative or not finite"
    if np.abs(skin.weights.sum(axis=1) - 1).max() > 1e-3:
        return "has a vertex whose skinning weights do not sum to 1"
    return None
