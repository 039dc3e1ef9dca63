"""Small artefacts and records for the tests of data_schemas."""

from __future__ import annotations

import resource
from contextlib import suppress
from pathlib import Path

import numpy as np

from data_schemas.artefact import Artefact, open_artefact, write_artefact
from data_schemas.motion import ClipRow, MotionWriter
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.tpc import BoneSet


def a_skeleton(joints: int = 3, seed: int = 0) -> Skeleton:
    """A chain of joints; joint 0 is not a part of the body."""
    rng = np.random.default_rng(seed)
    return Skeleton(
        names=tuple(f"joint {i}" for i in range(joints)),
        parents=np.arange(-1, joints - 1, dtype=np.int32),
        offsets=rng.normal(size=(joints, 3)),
        tails=rng.normal(size=(joints, 3)),
        groups=np.array([-1] + [i % 5 for i in range(joints - 1)], np.int8),
        sampled=np.arange(joints) > 0,
        root=min(1, joints - 1),
        unit_m=0.01,
        up_axis="z",
        header="HIERARCHY\r\nROOT a\t b\n",
    )


def unit_quaternions(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """(*shape, 4) float32 unit quaternions."""
    values = rng.normal(size=(*shape, 4)) + np.array([0, 0, 0, 3])
    return (values / np.linalg.norm(values, axis=-1, keepdims=True)).astype(np.float32)


def a_motion(frames: int = 10, joints: int = 3, tracked: int = 1, seed: int = 0) -> Motion:
    """A motion of a chain, with translation tracks on its last `tracked` joints."""
    rng = np.random.default_rng(seed)
    return Motion(
        rotations=unit_quaternions(rng, frames, joints),
        root_positions=rng.normal(size=(frames, 3)).astype(np.float32),
        fps=30.0,
        track_joints=np.arange(joints - tracked, joints, dtype=np.int32),
        tracks=rng.normal(size=(frames, tracked, 3)).astype(np.float32),
    )


def a_row(clip: str = "walk", skeleton: str = "", frames: int = 10, split: str = "train") -> ClipRow:
    """An index row at 30 frames a second."""
    return ClipRow(clip, f"archive.zip!{clip}.bvh", "0" * 64, skeleton, frames, 30.0, frames / 30, split, "zlib")


def some_bones(seed: int = 0) -> BoneSet:
    """Two bones and five points."""
    rng = np.random.default_rng(seed)
    return BoneSet(
        parents=np.array([-1, 0], np.int32),
        tails=rng.normal(size=(2, 3)).astype(np.float32),
        groups=np.array([0, 3], np.int8),
        weights=np.array([0.25, 0.75], np.float32),
        point_bones=np.array([0, 1, 1, 1, 0], np.int32),
        point_alphas=rng.uniform(size=5).astype(np.float32),
        point_offsets=rng.normal(size=(5, 3)).astype(np.float32),
    )


def write_motion(path: Path, seed: int = 0, frames: int = 10, **given) -> Artefact:
    """A motion artefact with one clip, `walk`."""
    settings = {"stage": "ingest", "config": {"seed": seed}, "licences": ["zlib"], **given}
    with write_artefact(path, "motion", **settings) as draft, MotionWriter(draft.folder) as writer:
        skeleton = writer.add_skeleton(a_skeleton())
        writer.add_clip(a_row(skeleton=skeleton, frames=frames), a_motion(frames, seed=seed))
    return open_artefact(path)


def write_text_artefact(path: Path, text: str, kind: str = "metrics", **given) -> Artefact:
    """An artefact of one text file, for tests that look at files and not into them."""
    with write_artefact(path, kind, **{"stage": "evaluate", "config": {}, **given}) as draft:
        (draft.folder / "summary.md").write_text(text, encoding="utf-8")
        (draft.folder / "copy.md").write_text(text, encoding="utf-8")
    return open_artefact(path)


def peak_mb(*, reset: bool = False) -> float:
    """Peak memory of this process in MB, with `reset` since now, where the system can forget an older peak."""
    if reset:
        with suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
