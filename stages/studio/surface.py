"""A body with a surface that moves as a motion does, for the page: a skinned body of anny's at the figure's size."""

from __future__ import annotations

import threading
from functools import lru_cache
from pathlib import Path

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from data_schemas.skinned_body import Body, Skin, Topology
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.bone_matching import size_ratio
from stages.shared.meshes.anny_bodies import draw_shapes, load_anny
from stages.shared.meshes.body_rig import put_on_body, rig_of_body

LARGEST_STEP = 32767  # of a quaternion's component
_loading = threading.Lock()


def surface_of(path: Path) -> bytes:
    """The surface of a BVH's motion, as `packed` writes it.

    Raises: PumpsError without the package anny; InputError where the motion cannot be put on a body.
    """
    skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), path.name))
    with _loading:  # two requests at a time would each load the model
        topology, body = _standing_body()
    return packed(*dressed(skeleton, motion, topology, body))


@lru_cache(maxsize=1)
def _standing_body() -> tuple[Topology, Body]:
    model = load_anny()
    return model.topology, model.body(draw_shapes(1, 0)[0])


def dressed(
    skeleton: Skeleton, motion: Motion, topology: Topology, body: Body
) -> tuple[Topology, Body, np.ndarray, np.ndarray]:
    """A motion on the bones of a body whose legs are as long as the skeleton's, so that both have one path.

    Returns: topology, the body at that size, rotations (T, J, 4) global xyzw, heads (T, J, 3) metres.
    """
    assert topology.skin is not None
    size = size_ratio(rig_of_body(topology.skin, body).skeleton, skeleton)
    scaled = Body((body.vertices * size).astype(np.float32), body.heads * size, body.shape)
    rotations, heads = put_on_body(skeleton, motion, rig_of_body(topology.skin, scaled))
    return topology, scaled, rotations, heads


def packed(topology: Topology, body: Body, rotations: np.ndarray, heads: np.ndarray) -> bytes:
    """All that the page needs to draw the surface, little-endian.

    The numbers N of vertices, W of bones of a vertex, F of triangles, J of bones and T of frames as uint32; vertices
    (N, 3) and heads (J, 3) at rest, float32 metres; triangles (F, 3), parents (J,) and bones (N, W), int32; weights
    (N, W) float32; places of bone 0, (T, 3) float32 metres; rotations (T, J, 4) global xyzw, int16
    of which `LARGEST_STEP` is 1.
    """
    skin = topology.skin
    assert isinstance(skin, Skin)
    frames, bones = rotations.shape[:2]
    counts = [len(body.vertices), skin.bones.shape[1], len(topology.faces), bones, frames]
    arrays = [
        np.array(counts, "<u4"), body.vertices.astype("<f4"), body.heads.astype("<f4"),
        topology.faces.astype("<i4"), skin.parents.astype("<i4"), skin.bones.astype("<i4"),
        skin.weights.astype("<f4"), heads[:, 0].astype("<f4"), np.round(rotations * LARGEST_STEP).astype("<i2"),
    ]  # fmt: skip
    return b"".join(array.tobytes() for array in arrays)
