"""The animated skin of a glTF file as motion: one clip for each animation, all on one skeleton.

In a file without a skin the animated nodes are the joints. Nodes above the joints place them in the world. A constant
scale is multiplied into the lengths, since skeletons here have no scales. Lengths are those of the nodes at rest, so
that they do not depend on what a clip shows; a joint that is elsewhere has a translation track.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.formats.bvh_header_write import plain_names
from stages.shared.formats.bvh_motion import rate_of
from stages.shared.formats.gltf import Document, reading_gltf
from stages.shared.formats.gltf_sampling import Track, sampled
from stages.shared.formats.recording import MAX_JOINTS, Asked, Recording, recording_of
from stages.shared.formats.source_body import SourcePoses, SourceRig
from stages.shared.kinematics.rotations import multiply, rotate

_PATHS = {"translation": 3, "rotation": 4, "scale": 3}
_SCALE_SLACK = 2e-3
_STILL = 1e-4  # of the body's size
_SPARSE_FPS, _USUAL_FPS, _MOST_FPS = 10.0, 30.0, 240.0
_LONGEST_S = 36_000.0
_DEEPEST = 1000  # most ancestors of a node


@dataclass(frozen=True)
class _Node:
    """One node at rest: translation, rotation xyzw, scale."""

    name: str
    parent: int
    translation: np.ndarray
    rotation: np.ndarray
    scale: np.ndarray


@dataclass(frozen=True)
class _Skin:
    """joints: nodes' indices, parents first. parents: indices into `joints`.

    above: rotation xyzw, scale and translation of the nodes above joint 0, which place it in the world.
    """

    joints: list[int]
    parents: list[int]
    above: tuple[np.ndarray, float, np.ndarray]


def read_gltf(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The clips of a file, one for each animation of its skin. Raises InputError naming the file."""
    with reading_gltf(name):
        document = Document(data, name)
        nodes = _Nodes(document)
        animations = [_tracks(document, animation) for animation in document.items("animations")]
        notes: list[Note] = []
        remarks: list[Note] = []
        animated = {node for tracks in animations for node, _ in tracks}
        skin = _skin(document, nodes, animated, notes, remarks)
        inside = set(skin.joints)
        moving = [(index, tracks) for index, tracks in enumerate(animations) if {n for n, _ in tracks} & inside]
        if not moving:
            raise InputError(f"{name} has no animation of its skin.", "Export it with its animation.")
        parts = plain_names([str(document.items("animations")[index].get("name", "")) for index, _ in moving])
        room = 600_000 + len(data) // 8
        sampled_clips = []
        for _, tracks in moving:
            tracks = {key: track for key, track in tracks.items() if key[0] in inside}
            clip = _sampled(document, nodes, skin, tracks, asked.fps_override, room)
            room -= len(clip.local) * len(skin.joints)
            sampled_clips.append(clip)
        rig = _rig(nodes, skin, sampled_clips)
        parts = parts if len(moving) > 1 else ("",)
        return [
            recording_of(name, rig, _poses(rig, skin, clip), asked, part=part, notes=notes, remarks=remarks)
            for part, clip in zip(parts, sampled_clips, strict=True)
        ]


# --- the scene ----------------------------------------------------------------------------------


class _Nodes:
    """The scene's nodes, each read on first access: most scenes hold many nodes that are not joints."""

    def __init__(self, document: Document):
        self._document = document
        self._parents = _parents(document)
        self._read: dict[int, _Node] = {}

    def __getitem__(self, index: int) -> _Node:
        if index not in self._read:
            listed = self._document.items("nodes")[index]
            self._read[index] = _node(self._document, listed, index, self._parents[index])
        return self._read[index]


def _parents(document: Document) -> list[int]:
    listed = document.items("nodes")
    parents = [-1] * len(listed)
    for index, node in enumerate(listed):
        for child in node.get("children", []):
            child = document.index(child, "nodes")
            if parents[child] >= 0 or child == index:
                raise InputError(f"{document.name}: node {child} has two parents.")
            parents[child] = index
    return parents


def _node(document: Document, node: dict[str, Any], index: int, parent: int) -> _Node:
    where = f"{document.name}: node {index}"
    name = str(node.get("name") or f"node_{index}")
    if "matrix" in node:
        matrix = _floats(node["matrix"], 16, where).reshape(4, 4).T
        scale = np.linalg.norm(matrix[:3, :3], axis=0)
        if (scale < 1e-9).any() or np.linalg.det(matrix[:3, :3]) <= 0:
            raise InputError(f"{where} is mirrored or flat.")
        rotation = Rotation.from_matrix(matrix[:3, :3] / scale).as_quat()
        return _Node(name, parent, matrix[:3, 3].copy(), rotation, scale)
    rotation = _floats(node.get("rotation", [0, 0, 0, 1]), 4, where)
    size = float(np.linalg.norm(rotation))
    if size < 0.1:
        raise InputError(f"{where} has a rotation of zero length.")
    translation = _floats(node.get("translation", [0, 0, 0]), 3, where)
    return _Node(name, parent, translation, rotation / size, _floats(node.get("scale", [1, 1, 1]), 3, where))


def _floats(values: Any, count: int, where: str) -> np.ndarray:
    array = np.array(values, np.float64)
    if array.shape != (count,) or not np.isfinite(array).all() or np.abs(array).max() > 1e9:
        raise InputError(f"{where} needs {count} finite numbers.")
    return array


def _tracks(document: Document, animation: dict[str, Any]) -> dict[tuple[int, str], Track]:
    """The animation's curves by node and path; curves of other paths (morph weights) are left out."""
    samplers, found = animation["samplers"], {}
    for channel in animation["channels"]:
        target = channel["target"]
        if "node" not in target or target["path"] not in _PATHS:
            continue
        node, which = document.index(target["node"], "nodes"), channel["sampler"]
        if type(which) is not int or not 0 <= which < len(samplers):
            raise InputError(f"{document.name}: a channel has no sampler.")
        sampler = samplers[which]
        found[node, target["path"]] = Track(
            times=document.numbers(sampler["input"])[:, 0],
            values=document.numbers(sampler["output"]),
            kind=str(sampler.get("interpolation", "LINEAR")),
            width=_PATHS[target["path"]],
            where=f"{document.name}: the {target['path']} of node {node}",
        )
    return found


def _skin(document: Document, nodes: _Nodes, animated: set[int], notes: list[Note], remarks: list[Note]) -> _Skin:
    """The skin with the most joints, with the nodes between its joints, and the nodes above it that are animated.

    Without a skin: the animated nodes of one tree, and the nodes below them that end its chains.
    """
    skins = [[document.index(j, "nodes") for j in skin["joints"]] for skin in document.items("skins")]
    if not skins or not max(skins, key=len):
        skins = [_animated_tree(document, nodes, animated)]
        remarks.append(note(Flag.NODES_AS_JOINTS))
    chosen = max(skins, key=len)
    others = {joint for skin in skins for joint in skin} - set(chosen)
    if len(others) + len(chosen) > MAX_JOINTS:
        raise InputError(f"{document.name} has {len(others) + len(chosen)} joints; pumps reads at most {MAX_JOINTS}.")
    lines = {joint: _upwards(nodes, joint, document.name) for joint in {*chosen, *others}}
    root = lines[chosen[0]][-1]
    shared = {joint for joint in others if lines[joint][-1] == root}  # other meshes of the same body
    inside = set(chosen) | shared
    if others - shared:
        notes.append(note(Flag.OTHER_SKINS, joints=len(others - shared)))
    common = set(lines[chosen[0]])
    for joint in inside:
        common &= set(lines[joint])
    if not common:
        raise InputError(
            f"{document.name}: the joints of its skin have no common ancestor.", "Put its root nodes under one node."
        )
    top = next(node for node in lines[chosen[0]] if node in common)
    above = _upwards(nodes, top, document.name)
    top = next((node for node in reversed(above) if node in animated), top)
    for joint in list(inside):
        for node in lines[joint]:
            inside.add(node)
            if node == top:
                break
    order = [top]
    children: dict[int, list[int]] = {}
    for node in sorted(inside):
        if node != top:
            children.setdefault(nodes[node].parent, []).append(node)
    for node in order:
        order += children.get(node, [])
    place = {node: index for index, node in enumerate(order)}
    parents = [-1, *(place[nodes[node].parent] for node in order[1:])]
    return _Skin(order, parents, _placement(document, nodes, above[above.index(top) + 1 :]))


def _animated_tree(document: Document, nodes: _Nodes, animated: set[int]) -> list[int]:
    """The animated nodes of the tree that has the most of them, and the nodes below them that carry nothing."""
    trees: dict[int, list[int]] = {}
    for node in sorted(animated):
        trees.setdefault(_upwards(nodes, node, document.name)[-1], []).append(node)
    if not trees:
        raise InputError(f"{document.name} has no skin and no animated nodes.", "Export it with its armature.")
    joints = max(trees.values(), key=len)
    listed = document.items("nodes")
    for node in joints:  # grows while it is walked through
        below = [child for child in listed[node].get("children", []) if child not in animated]
        joints += [child for child in below if not {"mesh", "camera", "skin"} & set(listed[child])]
    return joints


def _upwards(nodes: _Nodes, node: int, name: str) -> list[int]:
    """A node and its ancestors, from the node up to the scene's root."""
    line = [node]
    while nodes[line[-1]].parent >= 0:
        line.append(nodes[line[-1]].parent)
        if len(line) > _DEEPEST:
            raise InputError(f"{name}: its nodes form a cycle, or are nested deeper than {_DEEPEST}.")
    return line


def _placement(document: Document, nodes: _Nodes, above: list[int]) -> tuple[np.ndarray, float, np.ndarray]:
    turn, scale, place = np.array([0.0, 0.0, 0.0, 1.0]), 1.0, np.zeros(3)
    for node in reversed(above):
        place = place + scale * rotate(turn, nodes[node].translation)
        turn = multiply(turn, nodes[node].rotation)
        scale *= _even_scale(nodes[node].scale[None], f"{document.name}: node '{nodes[node].name[:60]}'")
    return turn, scale, place


def _even_scale(scales: np.ndarray, where: str) -> float:
    """The scale that all values of (T, 3) equal. Raises InputError if they differ."""
    mean = float(scales.mean())
    if mean <= 1e-9 or np.abs(scales - mean).max() > _SCALE_SLACK * mean:
        raise InputError(f"{where} is scaled unevenly or changes its scale.", "Apply its scale before exporting.")
    return mean


# --- the rig and its poses -------------------------------------------------------------------


@dataclass(frozen=True)
class _Clip:
    """One animation at even times: local rotations (T, J, 4), places in the parents' frames (T, J, 3), the rate.

    scales: (J,) the scale of the world in which each joint's place is measured.
    """

    local: np.ndarray
    places: np.ndarray
    fps: float
    scales: np.ndarray


def _sampled(
    document: Document,
    nodes: _Nodes,
    skin: _Skin,
    tracks: dict[tuple[int, str], Track],
    fps: float | None,
    room: int,
) -> _Clip:
    times, rate = _times(document, list(tracks.values()), room // len(skin.joints))
    local = np.empty((len(times), len(skin.joints), 4))
    places = np.empty((len(times), len(skin.joints), 3))
    scales, sizes = [1.0] * len(skin.joints), np.empty(len(skin.joints))
    turn, above, _ = skin.above
    for index, (node, parent) in enumerate(zip(skin.joints, skin.parents, strict=True)):
        rest = nodes[node]
        rotation, translation, scale = (tracks.get((node, path)) for path in ("rotation", "translation", "scale"))
        local[:, index] = rest.rotation if rotation is None else sampled(rotation, times)
        sizes[index] = size = above if parent < 0 else scales[parent]
        places[:, index] = size * (rest.translation if translation is None else sampled(translation, times))
        own = rest.scale[None] if scale is None else scale.values
        scales[index] = size * _even_scale(own, f"{document.name}: node '{rest.name[:60]}'")
    local[:, 0] = multiply(turn, local[:, 0])
    return _Clip(local, places, fps or rate, sizes)


def _rig(nodes: _Nodes, skin: _Skin, clips: list[_Clip]) -> SourceRig:
    """The one rig of all clips.

    A joint's offset is its node's place at rest. If all clips hold the joint still at one other
    place, it is that place.
    """
    resting = np.stack([nodes[node].translation for node in skin.joints])
    offsets = clips[0].scales[:, None] * resting
    offsets[0] = 0.0
    still = _still(offsets)
    held = clips[0].places[0]
    for joint in range(1, len(skin.joints)):
        unmoved = all(np.abs(clip.places[:, joint] - held[joint]).max() <= still for clip in clips)
        if unmoved and np.abs(held[joint] - offsets[joint]).max() > still:
            offsets[joint] = held[joint]
    return SourceRig(
        names=tuple(nodes[node].name for node in skin.joints),
        parents=tuple(skin.parents),
        offsets=tuple(map(tuple, offsets.tolist())),
        end_sites=((0.0, 0.0, 0.0),) * len(skin.joints),
        placed=tuple(joint == 0 for joint in range(len(skin.joints))),
        up_axis="y",
        usual_unit_m=1.0,
    )


def _still(offsets: np.ndarray) -> float:
    return _STILL * max(float(np.linalg.norm(offsets, axis=1).sum()), 1e-9) / 10


def _poses(rig: SourceRig, skin: _Skin, clip: _Clip) -> SourcePoses:
    """A clip on the rig; joints that are elsewhere than their offsets have tracks."""
    turn, _, place = skin.above
    root = place + rotate(turn, clip.places[:, 0])
    offsets = np.array(rig.offsets)
    strays = np.abs(clip.places - offsets).max(axis=(0, 2)) > _still(offsets)
    moving = [joint for joint in range(1, len(rig.names)) if strays[joint]]
    return SourcePoses(clip.local, root, clip.fps, moving, clip.places[:, moving])


def _times(document: Document, tracks: list[Track], most: int) -> tuple[np.ndarray, float]:
    """Times of the frames in seconds, and their rate: that of the densest curve, or 30 if all curves are sparse."""
    for track in tracks:
        track.check()
    first = min(float(track.times[0]) for track in tracks)
    last = max(float(track.times[-1]) for track in tracks)
    steps = [float(np.median(np.diff(track.times))) for track in tracks if len(track.times) > 1]
    rate = rate_of(round(min(steps), 6)) if steps and min(steps) > 1e-4 else _USUAL_FPS
    if not _SPARSE_FPS <= rate <= _MOST_FPS:
        rate = _USUAL_FPS
    if last - first > _LONGEST_S or (last - first) * rate + 1 > most:
        raise InputError(
            f"{document.name} has an animation of {last - first:.0f} s, which is too long for a file of its size."
        )
    count = round((last - first) * rate) + 1
    return np.minimum(first + np.arange(count) / rate, last), rate
