"""The player's scenes of BVH files and motion artefacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import MANIFEST_NAME
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.report.config import Config
from stages.report.drawings import Drawing, Heading, heading_of, scene_of
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.sources import source_named
from stages.shared.humanoid.stick_figure import stick_figure
from stages.shared.inference.keyframes import parse_keyframes
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.plain_motion import plain_motion

SLERP = "slerp"


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
        files = [played_file(name, str(path)) for name, path in members if (name, path) not in artefacts]
        if not artefacts:
            yield heading_of(scene) if scene else Heading(_scene_name(members)), files
        else:
            yield from _clips_of(scene, artefacts, files, config.max_clips)


def _scene_name(members: list[tuple[str, Path]]) -> str:
    return members[0][1].stem


def played_file(name: str, path: str) -> Played:
    """A BVH file, or a member of an archive. Raises InputError where it cannot be read."""
    source = source_named(path)
    skeleton, motion, _ = motion_of(read_bvh(source.read(), source.name))
    return Played(name, skeleton, motion)


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
    return played_scene(heading, motions, keys, config.max_seconds)


def played_scene(heading: Heading, motions: Sequence[Played], keys: np.ndarray, max_seconds: float) -> dict:
    """The scene of some motions, each cut after `max_seconds`."""
    kept = [replace(played, motion=_shortened(played.motion, max_seconds)) for played in motions]
    return scene_of(heading, keys, [_drawing_of(played) for played in kept])


def _drawing_of(played: Played) -> Drawing:
    skeleton, motion = played.skeleton, played.motion
    figure = stick_figure(skeleton, positions_of(skeleton, motion), motion.rotations)
    return Drawing(played.name, motion.fps, figure)


def slerped(skeleton: Skeleton, motion: Motion, keys: np.ndarray) -> Motion:
    """The motion with every frame that is not a key replaced by slerp between its keys. keys: (K,) rising."""
    known = np.isin(np.arange(motion.frames), keys)
    return plain_motion(skeleton, motion, np.repeat(known[:, None], skeleton.joints, axis=1), known)


def _shortened(motion: Motion, seconds: float) -> Motion:
    return motion.at(slice(int(seconds * motion.fps) + 1))
