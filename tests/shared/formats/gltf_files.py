"""glTF files for tests, written by pygltflib: the small humanoid of `bvh_texts` as a skin, turning from a seed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pygltflib as g
from scipy.spatial.transform import Rotation

from tests.shared.formats.bvh_texts import HUMANOID
from tests.shared.formats.glb_bytes import glb_with, parts_of_glb

NAMES = [name for name, *_ in HUMANOID]


@dataclass
class GltfText:
    """How to write the figure.

    kind: interpolation of every curve. scale, turn: of an armature node above the hips. parts: names of animations.
    bind: joints rest turned, as real rigs do. moving: joints with a translation curve. uri: JSON with base64 inside.
    """

    frames: int = 9
    fps: float = 30.0
    seed: int = 0
    kind: str = "LINEAR"
    scale: float = 1.0
    turn: tuple[float, float, float] = (0, 0, 0)
    parts: tuple[str, ...] = ("walk",)
    bind: bool = False
    moving: tuple[str, ...] = ("Hips",)
    joint_scale: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    matrix: bool = False
    uri: bool = False

    def rest(self) -> list[tuple[np.ndarray, Rotation]]:
        """Translation, in the armature's unit, and rotation of every joint at rest."""
        rng = np.random.default_rng(7)
        turned, out = {}, []
        for name, parent, offset in HUMANOID:
            own = Rotation.from_rotvec(rng.normal(0, 1, 3)) if self.bind else Rotation.identity()
            world = turned.get(parent, Rotation.identity())
            place = world.inv().apply(np.array(offset, float) / 100 / self.scale)
            turned[name] = own
            out.append((place, world.inv() * own))
        return out

    def curves(self, part: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Local rotations (T, J, 4) and translations (T, J, 3) of an animation."""
        rng = np.random.default_rng(self.seed + part)
        times = np.arange(self.frames) / self.fps
        rest = self.rest()
        turns = np.sin(times[:, None, None] * 3 + rng.uniform(0, 6, (len(NAMES), 3))) * rng.uniform(
            0, 0.4, (len(NAMES), 3)
        )
        rotations = np.stack(
            [(r * Rotation.from_rotvec(turns[:, j])).as_quat() for j, (_, r) in enumerate(rest)], axis=1
        )
        places = np.stack([np.tile(p, (self.frames, 1)) for p, _ in rest], axis=1)
        for name in self.moving:
            at = NAMES.index(name)
            drift = np.array([0.3, 0.0, 0.1]) * times[:, None] + (np.array([0, 0.95, 0]) if name == "Hips" else 0)
            places[:, at] += Rotation.from_euler("xyz", self.turn, degrees=True).inv().apply(drift) / self.scale
        return rotations, places

    def heads(self, part: int = 0) -> np.ndarray:
        """(T, J, 3) in the world, one frame and joint after another, with matrices."""
        rotations, places = self.curves(part)
        armature = np.eye(4)
        armature[:3, :3] = Rotation.from_euler("xyz", self.turn, degrees=True).as_matrix() * self.scale
        out = np.zeros((self.frames, len(NAMES), 3))
        for frame in range(self.frames):
            world: dict[str, np.ndarray] = {"": armature}
            for joint, (name, parent, _) in enumerate(HUMANOID):
                own = np.eye(4)
                own[:3, :3] = Rotation.from_quat(rotations[frame, joint]).as_matrix() * self.joint_scale.get(
                    name, (1, 1, 1)
                )
                own[:3, 3] = places[frame, joint]
                world[name] = world[parent] @ own
                out[frame, joint] = world[name][:3, 3]
        return out

    def data(self) -> bytes:
        gltf = g.GLTF2(asset=g.Asset(version="2.0"))
        blob = bytearray()

        def stored(values: np.ndarray, kind: str) -> int:
            content = np.ascontiguousarray(values, np.float32).tobytes()
            gltf.bufferViews.append(g.BufferView(buffer=0, byteOffset=len(blob), byteLength=len(content)))
            gltf.accessors.append(
                g.Accessor(bufferView=len(gltf.bufferViews) - 1, componentType=g.FLOAT, count=len(values), type=kind)
            )
            blob.extend(content)
            return len(gltf.accessors) - 1

        for (name, _, _), (place, turn) in zip(HUMANOID, self.rest(), strict=True):
            children = [NAMES.index(child) + 1 for child, above, _ in HUMANOID if above == name]
            node = g.Node(name=name, translation=place.tolist(), rotation=turn.as_quat().tolist(), children=children)
            if name in self.joint_scale:
                node.scale = list(self.joint_scale[name])
            gltf.nodes.append(node)
        armature = g.Node(name="Armature", children=[1])
        turn = Rotation.from_euler("xyz", self.turn, degrees=True)
        if self.matrix:
            whole = np.eye(4)
            whole[:3, :3] = turn.as_matrix() * self.scale
            armature.matrix = whole.T.reshape(-1).tolist()
        else:
            armature.rotation, armature.scale = turn.as_quat().tolist(), [self.scale] * 3
        gltf.nodes.insert(0, armature)
        gltf.skins.append(g.Skin(joints=list(range(1, len(NAMES) + 1))))
        gltf.scenes.append(g.Scene(nodes=[0]))
        times = stored((np.arange(self.frames) / self.fps)[:, None], "SCALAR")
        for part, title in enumerate(self.parts):
            animation = g.Animation(name=title)
            rotations, places = self.curves(part)
            tracks = [(j, "rotation", rotations[:, j], "VEC4") for j in range(len(NAMES))]
            tracks += [
                (NAMES.index(name), "translation", places[:, NAMES.index(name)], "VEC3") for name in self.moving
            ]
            for joint, path, values, kind in tracks:
                if self.kind == "CUBICSPLINE":
                    values = np.stack([values * 0, values, values * 0], axis=1).reshape(-1, values.shape[1])
                animation.samplers.append(
                    g.AnimationSampler(input=times, output=stored(values, kind), interpolation=self.kind)
                )
                target = g.AnimationChannelTarget(node=joint + 1, path=path)
                animation.channels.append(g.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))
            gltf.animations.append(animation)
        gltf.buffers.append(g.Buffer(byteLength=len(blob)))
        gltf.set_binary_blob(bytes(blob))
        if self.uri:
            gltf.convert_buffers(g.BufferFormat.DATAURI)
            return gltf.gltf_to_json().encode()
        return b"".join(gltf.save_to_bytes())


def edited(text: GltfText, change: Callable[[Any], object]) -> bytes:
    """The GLB with its JSON changed."""
    inner, rest = parts_of_glb(text.data())
    scene = json.loads(inner)
    change(scene)
    return glb_with(json.dumps(scene).encode(), rest)
