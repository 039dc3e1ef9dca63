"""Writing GLB: a skeleton of nodes with an animated skin of bones, for Blender, three.js, game engines.

Metres, Y up, quaternions xyzw, linear samplers, one buffer. Every joint has a small octahedron of its own in the
skinned mesh, since importers drop joints that no vertex uses.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pygltflib as gltf

from data_schemas.errors import PumpsError
from data_schemas.skeleton import NO_GROUP, Motion, Skeleton
from data_schemas.version import PUMPS_VERSION
from stages.shared.humanoid.reference_pose import turn_to_y_up
from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.rotations import CONJUGATE, multiply, rotate

_LEAST_BONE_M = 0.01
_WAIST = 0.1  # of a bone's length: where its octahedron is widest, and how wide
# Colours of the body groups, and of joints outside the body; linear RGB.
_COLOURS = {
    0: (0.55, 0.55, 0.58), 1: (0.10, 0.45, 0.20), 2: (0.62, 0.12, 0.10), 3: (0.10, 0.35, 0.62), 4: (0.75, 0.45, 0.05),
    NO_GROUP: (0.25, 0.25, 0.25),
}  # fmt: skip
_TYPES = {1: gltf.SCALAR, 3: gltf.VEC3, 4: gltf.VEC4, 16: gltf.MAT4}


def glb_of_motion(skeleton: Skeleton, motion: Motion, name: str, *, bind: str = "rest", licence: str = "") -> bytes:
    """The bytes of a GLB.

    Args:
        name: of the animation.
        bind: pose in which the skin is bound, shown while no animation plays: "rest" for zero rotations, "first" for
            the first frame (for a rig whose zero pose is not a human pose).
        licence: written as the asset's copyright.
    Raises: PumpsError if a number to write is not finite.
    """
    local = local_rotations_of(skeleton, motion)
    heads = np.tile(skeleton.offsets, (motion.frames, 1, 1))
    if len(motion.track_joints):  # without them, `tracks` may have no rows
        heads[:, motion.track_joints] = motion.tracks
    heads[:, 0] = motion.root_positions
    if not (np.isfinite(local).all() and np.isfinite(heads).all()):
        raise PumpsError(f"{name}: a number to write is not finite.")
    turns, places = local[0], heads[0]
    if bind == "rest":
        turns = np.tile((0.0, 0.0, 0.0, 1.0), (skeleton.joints, 1))
        turns[0] = _upright(skeleton)
    document = GlbDocument()
    joints = [bone_node(skeleton.names[j], places[j], turns[j]) for j in range(skeleton.joints)]
    for joint, parent in enumerate(skeleton.parents.tolist()):
        if parent >= 0:
            joints[parent].children = [*(joints[parent].children or []), joint]
    world_turns, world_places = _world(skeleton.parents, places, turns)
    document.out.nodes = [*joints, gltf.Node(name="bones", mesh=0, skin=0)]
    document.out.scenes = [gltf.Scene(name="scene", nodes=[0, skeleton.joints])]
    document.out.scene = 0
    document.add_skin(skeleton, world_turns, world_places)
    document.add_mesh(skeleton, world_turns, world_places)
    document.add_animation(name, motion, local, heads, sorted({0, *motion.track_joints.tolist()}))
    document.out.asset = gltf.Asset(version="2.0", generator=f"pumps {PUMPS_VERSION}", copyright=licence or None)
    return document.bytes()


def _upright(skeleton: Skeleton) -> np.ndarray:
    """The rotation (4,) of joint 0 in which the rest pose stands upright.

    The source's up axis is that of the motion; the rest pose may have another one.
    """
    still = np.array((0.0, 0.0, 0.0, 1.0))
    turn = turn_to_y_up(skeleton.up_axis)
    if turn is None:
        return still
    _, places = _world(skeleton.parents, skeleton.offsets, np.tile(still, (skeleton.joints, 1)))
    arms, legs = (places[np.isin(skeleton.groups, groups)] for groups in ((1, 2), (3, 4)))
    rise = arms.mean(axis=0) - legs.mean(axis=0)
    return still if rise[1] > turn.apply(rise)[1] else turn.as_quat()


def bone_node(name: str, place: np.ndarray, turn: np.ndarray) -> gltf.Node:
    turn = turn / np.linalg.norm(turn)
    return gltf.Node(name=name, translation=[float(v) for v in place], rotation=[float(v) for v in turn])


def _world(parents: np.ndarray, places: np.ndarray, turns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Global rotations (J, 4) and places (J, 3) from local ones."""
    out_turns, out_places = turns.copy(), places.copy()
    for joint in range(1, len(parents)):
        above = parents[joint]
        out_turns[joint] = multiply(out_turns[above], turns[joint])
        out_places[joint] = out_places[above] + rotate(out_turns[above], places[joint])
    return out_turns, out_places


@dataclass
class GlbDocument:
    """A glTF document and its one buffer."""

    out: gltf.GLTF2 = field(default_factory=lambda: gltf.GLTF2())
    buffer: bytearray = field(default_factory=bytearray)

    def add(
        self, values: np.ndarray, target: int | None = None, *, bounds: bool = False, normal: bool = False
    ) -> int:
        """Add an accessor of an array (N,) or (N, width) of float32 or unsigned integers; returns its index."""
        kinds = {"f": gltf.FLOAT, "u1": gltf.UNSIGNED_BYTE, "u2": gltf.UNSIGNED_SHORT, "u4": gltf.UNSIGNED_INT}
        component = kinds["f" if values.dtype.kind == "f" else values.dtype.str[1:]]
        self.buffer += b"\0" * (-len(self.buffer) % 4)
        data = np.ascontiguousarray(values).tobytes()
        view = gltf.BufferView(buffer=0, byteOffset=len(self.buffer), byteLength=len(data), target=target)
        self.buffer += data
        self.out.bufferViews.append(view)
        width = 1 if values.ndim == 1 else values.shape[1]
        accessor = gltf.Accessor(
            bufferView=len(self.out.bufferViews) - 1, byteOffset=0, componentType=component, count=len(values),
            type=_TYPES[width], normalized=normal or None,
        )  # fmt: skip
        if bounds:
            flat = values.reshape(len(values), width)
            accessor.min, accessor.max = flat.min(axis=0).tolist(), flat.max(axis=0).tolist()
        self.out.accessors.append(accessor)
        return len(self.out.accessors) - 1

    def add_skin(self, skeleton: Skeleton, turns: np.ndarray, places: np.ndarray) -> None:
        inverse = turns * CONJUGATE
        matrices = np.zeros((skeleton.joints, 4, 4))
        for row in range(3):  # columns of the inverse rotation; glTF's matrices are column-major
            axis = np.tile(np.eye(3)[row], (skeleton.joints, 1))
            matrices[:, row, :3] = rotate(inverse, axis)
        matrices[:, 3, :3] = -rotate(inverse, places)
        matrices[:, 3, 3] = 1.0
        accessor = self.add(matrices.reshape(-1, 16).astype(np.float32))
        self.out.skins = [
            gltf.Skin(name="skeleton", inverseBindMatrices=accessor, skeleton=0, joints=list(range(skeleton.joints)))
        ]

    def add_mesh(self, skeleton: Skeleton, turns: np.ndarray, places: np.ndarray) -> None:
        corners, normals = _octahedra(skeleton.tails)
        each = len(corners[0])
        joints = np.repeat(np.arange(skeleton.joints), each)
        points = rotate(turns[joints], corners.reshape(-1, 3)) + places[joints]
        normals = rotate(turns[joints], normals.reshape(-1, 3))
        bones = np.zeros((len(joints), 4), np.uint16 if skeleton.joints > 255 else np.uint8)
        bones[:, 0] = joints
        weights = np.zeros((len(joints), 4), np.float32)
        weights[:, 0] = 1.0
        colours = np.array([(*_COLOURS[int(group)], 1.0) for group in skeleton.groups], np.float32)[joints]
        primitive = gltf.Primitive(
            attributes=gltf.Attributes(
                POSITION=self.add(points.astype(np.float32), gltf.ARRAY_BUFFER, bounds=True),
                NORMAL=self.add(normals.astype(np.float32), gltf.ARRAY_BUFFER),
                COLOR_0=self.add((colours * 255).round().astype(np.uint8), gltf.ARRAY_BUFFER, normal=True),
                JOINTS_0=self.add(bones, gltf.ARRAY_BUFFER),
                WEIGHTS_0=self.add(weights, gltf.ARRAY_BUFFER),
            ),
            indices=self.add(np.arange(len(joints), dtype=np.uint32), gltf.ELEMENT_ARRAY_BUFFER),
            material=0,
        )
        self.out.meshes = [gltf.Mesh(name="bones", primitives=[primitive])]
        shine = gltf.PbrMetallicRoughness(metallicFactor=0.0, roughnessFactor=0.8)
        self.out.materials = [
            gltf.Material(name="bones", pbrMetallicRoughness=shine, doubleSided=True, alphaCutoff=None)
        ]

    def add_animation(
        self, name: str, motion: Motion, local: np.ndarray, heads: np.ndarray, placed: list[int]
    ) -> None:
        times = self.add((np.arange(motion.frames) / motion.fps).astype(np.float32), bounds=True)
        animation = gltf.Animation(name=name)

        def animate(joint: int, path: str, values: np.ndarray) -> None:
            sampler = gltf.AnimationSampler(
                input=times, output=self.add(values.astype(np.float32)), interpolation=gltf.ANIM_LINEAR
            )
            animation.samplers.append(sampler)
            target = gltf.AnimationChannelTarget(node=joint, path=path)
            animation.channels.append(gltf.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

        for joint in placed:
            animate(joint, "translation", heads[:, joint])
        for joint in range(local.shape[1]):
            animate(joint, "rotation", local[:, joint])
        self.out.animations = [animation]

    def bytes(self) -> bytes:
        self.out.buffers = [gltf.Buffer(byteLength=len(self.buffer))]
        self.out.set_binary_blob(bytes(self.buffer))
        return b"".join(self.out.save_to_bytes())


def _octahedra(tails: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(J, 24, 3) corners of the eight faces of every bone's octahedron, in the joint's own frame, and their normals.

    A bone without length gets a small octahedron along its own Y.
    """
    lengths = np.linalg.norm(tails, axis=1)
    ends = np.where(lengths[:, None] < _LEAST_BONE_M, (0.0, _LEAST_BONE_M, 0.0), tails)
    lengths = np.linalg.norm(ends, axis=1, keepdims=True)
    along = ends / lengths
    other = np.where(np.abs(along[:, :1]) < 0.8, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    side = np.cross(along, other)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    front = np.cross(along, side)
    width = _WAIST * lengths
    ring = [ends * _WAIST + width * offset for offset in (side, front, -side, -front)]
    corners = []
    for i in range(4):
        a, b = ring[i], ring[(i + 1) % 4]
        corners += [b, a, np.zeros_like(ends), a, b, ends]
    points = np.stack(corners, axis=1)
    faces = points.reshape(len(tails), 8, 3, 3)
    normals = np.cross(faces[:, :, 1] - faces[:, :, 0], faces[:, :, 2] - faces[:, :, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return points, np.repeat(normals, 3, axis=1).reshape(len(tails), 24, 3)
