"""Writing a skinned mesh sequence as GLB: one body, its bones, an animation of their rotations; no baked frames."""

from __future__ import annotations

import numpy as np
import pygltflib as gltf

from data_schemas.errors import PumpsError
from data_schemas.skinned_body import Body, Topology
from data_schemas.version import PUMPS_VERSION
from stages.shared.formats.gltf_write import GlbDocument, bone_node
from stages.shared.kinematics.forward_numpy import local_rotations
from stages.shared.kinematics.rotations import continuous_signs

_STILL = np.array((0.0, 0.0, 0.0, 1.0))
_COLOUR = [0.72, 0.74, 0.78, 1.0]


def glb_of_body(
    topology: Topology, body: Body, rotations: np.ndarray, heads: np.ndarray, fps: float, name: str, licence: str = ""
) -> bytes:
    """The bytes of a GLB.

    Args:
        rotations: (T, J, 4) global, xyzw. heads: (T, J, 3) metres; bones keep their length, so that the place of bone
            0 and the rotations are animated.
        name: of the animation. licence: written as the asset's copyright.
    Raises: PumpsError if the topology has no skin, or a number is not finite.
    """
    skin = topology.skin
    if skin is None:
        raise PumpsError("A mesh without bones cannot be written as a skin.", "Write a page: -o meshes.html.")
    if not (np.isfinite(rotations).all() and np.isfinite(heads).all()):
        raise PumpsError(f"{name}: a number to write is not finite.")
    bones = len(skin.names)
    offsets = body.heads.copy()
    offsets[1:] -= body.heads[skin.parents[1:]]
    local = continuous_signs(local_rotations(rotations.astype(np.float64), skin.parents))
    document = GlbDocument()
    nodes = [bone_node(skin.names[bone], offsets[bone], _STILL) for bone in range(bones)]
    for bone, parent in enumerate(skin.parents.tolist()):
        if parent >= 0:
            nodes[parent].children = [*(nodes[parent].children or []), bone]
    document.out.nodes = [*nodes, gltf.Node(name="body", mesh=0, skin=0)]
    document.out.scenes, document.out.scene = [gltf.Scene(name="scene", nodes=[0, bones])], 0
    _add_skin(document, skin.names, body)
    _add_mesh(document, topology, body)
    times = document.add((np.arange(len(rotations)) / fps).astype(np.float32), bounds=True)
    animation = gltf.Animation(name=name)
    tracks = [(0, "translation", heads[:, 0]), *((bone, "rotation", local[:, bone]) for bone in range(bones))]
    for bone, path, values in tracks:
        output = document.add(values.astype(np.float32))
        animation.samplers.append(gltf.AnimationSampler(input=times, output=output, interpolation=gltf.ANIM_LINEAR))
        target = gltf.AnimationChannelTarget(node=bone, path=path)
        animation.channels.append(gltf.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))
    document.out.animations = [animation]
    document.out.asset = gltf.Asset(version="2.0", generator=f"pumps {PUMPS_VERSION}", copyright=licence or None)
    return document.bytes()


def _add_skin(document: GlbDocument, names: tuple[str, ...], body: Body) -> None:
    matrices = np.tile(np.eye(4), (len(names), 1, 1))
    matrices[:, 3, :3] = -body.heads  # glTF's matrices are column-major
    accessor = document.add(matrices.reshape(-1, 16).astype(np.float32))
    document.out.skins = [
        gltf.Skin(name="skeleton", inverseBindMatrices=accessor, skeleton=0, joints=list(range(len(names))))
    ]


def _add_mesh(document: GlbDocument, topology: Topology, body: Body) -> None:
    skin, vertices = topology.skin, body.vertices
    assert skin is not None
    attributes = gltf.Attributes(
        POSITION=document.add(vertices.astype(np.float32), gltf.ARRAY_BUFFER, bounds=True),
        NORMAL=document.add(vertex_normals(vertices, topology.faces), gltf.ARRAY_BUFFER),
    )
    # The heaviest four bones of a vertex, then the next four where there are any: glTF takes them in fours.
    order = np.argsort(-skin.weights, axis=1, kind="stable")
    bones, weights = (np.take_along_axis(values, order, axis=1) for values in (skin.bones, skin.weights))
    for which, start in enumerate(range(0, bones.shape[1], 4)):
        some = np.zeros((len(bones), 4), np.uint16 if len(skin.names) > 255 else np.uint8)
        parts = np.zeros((len(bones), 4), np.float32)
        count = min(4, bones.shape[1] - start)
        parts[:, :count] = weights[:, start : start + count]
        some[:, :count] = np.where(parts[:, :count] > 0, bones[:, start : start + count], 0)
        if which and not parts.any():
            break
        setattr(attributes, f"JOINTS_{which}", document.add(some, gltf.ARRAY_BUFFER))
        setattr(attributes, f"WEIGHTS_{which}", document.add(parts, gltf.ARRAY_BUFFER))
    indices = document.add(topology.faces.ravel().astype(np.uint32), gltf.ELEMENT_ARRAY_BUFFER)
    document.out.meshes = [
        gltf.Mesh(name="body", primitives=[gltf.Primitive(attributes=attributes, indices=indices, material=0)])
    ]
    shine = gltf.PbrMetallicRoughness(baseColorFactor=_COLOUR, metallicFactor=0.0, roughnessFactor=0.9)
    document.out.materials = [gltf.Material(name="body", pbrMetallicRoughness=shine, alphaCutoff=None)]


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (N, 3) float32: the mean of the triangles at a vertex, weighted by their areas."""
    corners = vertices[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices, np.float64)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], areas)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 1e-12, normals / np.maximum(length, 1e-12), (0.0, 1.0, 0.0)).astype(np.float32)
