"""The player's scenes: motions of BVH files and motion artefacts, as joint positions the page can hold."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import MANIFEST_NAME
from data_schemas.motion import MotionReader
from data_schemas.skeleton import NO_GROUP, Motion, Skeleton
from stages.report.config import Config
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.sources import source_named
from stages.shared.inference.keyframes import parse_keyframes
from stages.shared.kinematics.forward import global_rotations, local_rotations, offsets_over_time, positions_of
from stages.shared.kinematics.plain_interpolation import interpolate_pose

SLERP = "slerp"
LARGEST_STEP = 32767  # positions travel as 16-bit numbers, a fraction of a millimetre apart
LEAST_BONE_M = 1e-4


@dataclass(frozen=True)
class Heading:
    """What a scene is called: a title, and in smaller letters a detail, which may be ""."""

    title: str
    detail: str = ""

    @property
    def name(self) -> str:
        """Both in one line."""
        return f"{self.title}: {self.detail}" if self.detail else self.title


def heading_of(given: str) -> Heading:
    """The heading that the user wrote as `TITLE` or `TITLE: DETAIL`."""
    title, _, detail = given.partition(": ")
    return Heading(title, detail)


@dataclass(frozen=True)
class Played:
    """A motion to play."""

    name: str
    skeleton: Skeleton
    motion: Motion


def scenes_of(config: Config) -> list[dict]:
    """All scenes as plain data for the page.

    Raises:
        UsageError: a motion is not NAME=PATH.
        InputError: a file is bad, or artefacts of a scene share no clip.
    """
    named = _named_keyframes(config)
    scenes = [
        _scene(heading, motions, config, named.get(heading.name, config.keyframes))
        for heading, motions in _loaded(config)
    ]
    unknown = sorted(set(named) - {scene["name"] for scene in scenes})
    if unknown:
        raise UsageError(f"No scene is called {unknown[0]!r}.", "Name in --scene-keyframes those of --motions.")
    return scenes


def _named_keyframes(config: Config) -> dict[str, str]:
    found = {}
    for text in config.scene_keyframes:
        scene, equals, frames = text.rpartition("=")
        if not (scene and equals and frames):
            raise UsageError(f"--scene-keyframes {text!r} is not SCENE=FRAMES.", "Write for instance walk=every:30.")
        found[scene] = frames
    return found


def _loaded(config: Config) -> Iterator[tuple[Heading, list[Played]]]:
    scenes: dict[str, list[tuple[str, Path]]] = {}
    for text in config.motions:
        label, equals, path = text.partition("=")
        if not equals or not label or not path:
            raise UsageError(f"--motions {text!r} is not NAME=PATH.", "Write for instance --motions truth=walk.bvh.")
        scene, _, name = label.rpartition("/")
        scenes.setdefault(scene, []).append((name, Path(path)))
    for scene, members in scenes.items():
        artefacts = [(name, path) for name, path in members if (path / MANIFEST_NAME).is_file() or path.is_dir()]
        files = [Played(name, *_read_file(path)) for name, path in members if (name, path) not in artefacts]
        if not artefacts:
            yield heading_of(scene) if scene else Heading(_scene_name(members)), files
        else:
            yield from _clips_of(scene, artefacts, files, config.max_clips)


def _scene_name(members: list[tuple[str, Path]]) -> str:
    return members[0][1].stem


def _read_file(path: Path) -> tuple[Skeleton, Motion]:
    source = source_named(str(path))
    skeleton, motion, _ = motion_of(read_bvh(source.read(), source.name))
    return skeleton, motion


def _clips_of(
    scene: str, artefacts: list[tuple[str, Path]], files: list[Played], limit: int
) -> Iterator[tuple[Heading, list[Played]]]:
    """One scene a clip that all artefacts have."""
    readers = [(name, MotionReader(path)) for name, path in artefacts]
    try:
        shared = set.intersection(*({row.clip for row in reader.clips} for _, reader in readers))
        if not shared:
            raise InputError(
                f"The motion artefacts {', '.join(str(path) for _, path in artefacts)} share no clip.",
                "Play artefacts that were made from one another.",
            )
        chosen = [row.clip for row in readers[-1][1].clips if row.clip in shared][:limit]
        for clip in chosen:
            played = [
                Played(name, reader.skeleton(reader.row(clip).skeleton), reader.motion(clip))
                for name, reader in readers
            ]
            detail = clip.removeprefix(f"{scene}.")  # clips of an archive begin with its name
            yield (Heading(scene, detail) if scene else Heading(clip)), played + files
    finally:
        for _, reader in readers:
            reader.close()


def _scene(heading: Heading, motions: list[Played], config: Config, keyframes: str) -> dict:
    first = motions[0]
    keys = parse_keyframes(keyframes, first.motion.frames)
    if config.slerp and all(played.name != SLERP for played in motions):
        motions = [first, Played(SLERP, first.skeleton, slerped(first.skeleton, first.motion, keys)), *motions[1:]]
    kept = [replace(played, motion=_shortened(played.motion, config.max_seconds)) for played in motions]
    drawings = [_drawing_of(played) for played in kept]
    cloud = drawings[0].points
    origin = cloud[:, drawings[0].root].mean(axis=0) * [1, 0, 1]
    return {
        "name": heading.name,
        "title": heading.title,
        "detail": heading.detail,
        "keys": [int(key) for key in keys if key < len(cloud)],
        "floor": round(float(np.percentile(cloud[..., 1].min(axis=1), 2)), 4),
        "height": round(float(np.percentile(np.ptp(cloud[..., 1], axis=1), 90)), 4),
        "size": round(float(np.percentile(np.ptp(cloud, axis=1).max(axis=1), 90)), 4),
        "motions": [_packed(played, drawing, origin) for played, drawing in zip(kept, drawings, strict=True)],
    }


def slerped(skeleton: Skeleton, motion: Motion, keys: np.ndarray) -> Motion:
    """The motion with every frame that is not a key replaced by slerp between its keys. keys: (K,) rising."""
    local = local_rotations(torch.as_tensor(motion.rotations), skeleton.parents)[keys]
    roots = torch.as_tensor(motion.root_positions)[keys]
    offsets = offsets_over_time(skeleton, motion)
    times = torch.arange(motion.frames, dtype=torch.float64)
    at_keys = offsets[keys] if offsets.dim() == 3 else offsets
    local, roots, offsets = interpolate_pose(local, roots, at_keys, torch.as_tensor(keys, dtype=torch.float64), times)
    tracks = offsets[:, motion.track_joints].numpy() if offsets.dim() == 3 else motion.tracks
    return replace(
        motion,
        rotations=global_rotations(local, skeleton.parents).numpy(),
        root_positions=roots.numpy(),
        tracks=tracks,
    )


def _shortened(motion: Motion, seconds: float) -> Motion:
    return motion.at(slice(int(seconds * motion.fps) + 1))


@dataclass(frozen=True)
class _Drawing:
    """What is drawn: points (T, N, 3) in the world; edges [from, to, body group, is thin, is head]; the pelvis."""

    points: np.ndarray
    edges: list[list[int]]
    root: int


def _drawing_of(played: Played) -> _Drawing:
    """The body's joints, and the tips of its last bones."""
    skeleton, motion = played.skeleton, played.motion
    heads = positions_of(skeleton, motion)
    body = np.flatnonzero(skeleton.groups != NO_GROUP)
    number = {int(joint): node for node, joint in enumerate(body)}
    points = [heads[:, body]]
    edges: list[list[int]] = []
    for joint in body:
        above = int(skeleton.parents[joint])
        if above in number:
            # A bone is drawn as what its far joint is; the spine's way to a hip or shoulder belongs to the limb.
            edges.append([number[above], number[int(joint)], *_look(skeleton, int(joint))])
    head = _head(skeleton)
    for joint in _last_joints(skeleton, body, head):
        tips = Rotation.from_quat(motion.rotations[:, joint]).apply(skeleton.tails[joint])
        points.append((heads[:, joint] + tips)[:, None])
        edges.append([number[joint], len(body) + len(points) - 2, *_look(skeleton, joint, ball=joint == head)])
    return _Drawing(np.concatenate(points, axis=1), edges, number[int(skeleton.root)])


def _packed(played: Played, drawing: _Drawing, origin: np.ndarray) -> dict:
    """A motion as the page holds it, its points around `origin` as 16-bit numbers."""
    cloud = drawing.points - origin
    scale = max(float(np.abs(cloud).max()), 1e-6) / LARGEST_STEP
    return {
        "name": played.name,
        "fps": round(float(played.motion.fps), 6),
        "frames": cloud.shape[0],
        "nodes": cloud.shape[1],
        "root": drawing.root,
        "edges": drawing.edges,
        "scale": scale,
        "points": base64.b64encode(np.round(cloud / scale).astype("<i2").tobytes()).decode(),
    }


def _last_joints(skeleton: Skeleton, body: np.ndarray, head: int | None) -> list[int]:
    """Joints whose bone's tip is not another joint; the head's is drawn though eyes hang on it."""
    carrying = set(skeleton.parents.tolist()) - {head}
    lengths = np.linalg.norm(skeleton.tails, axis=1)
    return [int(joint) for joint in body if int(joint) not in carrying and lengths[joint] > LEAST_BONE_M]


def _look(skeleton: Skeleton, joint: int, *, ball: bool = False) -> list[int]:
    """Body group, 1 for a thin bone (a finger), 1 for the bone that carries the head's ball."""
    # An unsampled joint that carries the body on, such as a zero-length hip, is not a finger.
    sampled = skeleton.sampled[joint] or any(skeleton.sampled[child] for child in _below(skeleton, joint))
    return [int(skeleton.groups[joint]), int(not sampled), int(ball)]


def _head(skeleton: Skeleton) -> int | None:
    """The joint that carries the head, by name: the head, or a neck that nothing follows; a robot may have none."""
    names = [name.lower() if skeleton.sampled[j] else "" for j, name in enumerate(skeleton.names)]
    heads = [j for j, name in enumerate(names) if "head" in name]
    necks = [j for j, name in enumerate(names) if "neck" in name and j not in skeleton.parents]
    return next(iter(heads + necks), None)


def _below(skeleton: Skeleton, joint: int) -> Iterator[int]:
    for child in np.flatnonzero(skeleton.parents == joint):
        yield int(child)
        yield from _below(skeleton, int(child))
