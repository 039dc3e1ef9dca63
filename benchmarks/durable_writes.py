"""What it costs that outputs are flushed to the disk before they replace the old ones, and digested by content.

    python benchmarks/durable_writes.py [FOLDER]

Writes files and motion artefacts of several sizes into FOLDER (default: a folder for temporary files), with and
without flushing, in turns, and prints the median seconds of each as a Markdown table. The limit of a write is that of
the disk: as many bytes written to one file and flushed, in the same turns.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from unittest import mock

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.content_digest import content_digest
from data_schemas.motion import ClipRow, MotionWriter
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.whole_file import write_whole

TURNS = 7
JOINTS = 22


def _skeleton() -> Skeleton:
    return Skeleton(
        names=tuple(f"j{joint}" for joint in range(JOINTS)),
        parents=np.arange(-1, JOINTS - 1, dtype=np.int32),
        offsets=np.zeros((JOINTS, 3)),
        tails=np.ones((JOINTS, 3)),
        groups=np.zeros(JOINTS, np.int8),
        sampled=np.ones(JOINTS, bool),
        root=0,
    )


def _motion(frames: int, seed: int) -> Motion:
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.normal(size=(frames, JOINTS, 4)), axis=0) + np.array([0, 0, 0, 50])
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    places = np.cumsum(rng.normal(size=(frames, 3)), axis=0)
    return Motion(turns.astype(np.float32), places.astype(np.float32), 30.0)


def _write_motions(path: Path, motions: list[Motion]) -> None:
    with write_artefact(path, "motion", stage="bench", config={}) as draft, MotionWriter(draft.folder) as writer:
        skeleton = writer.add_skeleton(_skeleton())
        for number, motion in enumerate(motions):
            seconds = motion.frames / 30
            row = ClipRow(f"clip{number}", "", "", skeleton, motion.frames, 30.0, seconds, "train", "")
            writer.add_clip(row, motion)


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def _write_at_once(path: Path, data: bytes) -> None:
    """The same number of bytes in one file, flushed: what the disk allows."""
    with open(path, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="a folder on the disk to measure")
    given = parser.parse_args().folder
    print(
        "| written | MB | with flushing, s | without, s | of it digests of content, s | at the limit, s | reached |"
    )
    print("|---|---:|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory(dir=given) as place:
        works: list[tuple[str, Callable[[], object], Path]] = []
        for size in (100_000, 10_000_000):
            path, data = Path(place) / f"{size}.bvh", os.urandom(size)
            works.append(("a file", lambda path=path, data=data: write_whole(path, data), path))
        for clips in (1, 100):
            path, motions = Path(place) / f"motion{clips}", [_motion(600, seed) for seed in range(clips)]
            name = f"a motion artefact of {clips} clip{'s' if clips > 1 else ''}"
            works.append((name, lambda path=path, motions=motions: _write_motions(path, motions), path))
        for name, work, path in works:
            flushed, plain, digested, limit = [], [], [], []
            work()
            files = [each for each in ([path] if path.is_file() else path.rglob("data-*/*.*")) if each.is_file()]
            raw = b"".join(each.read_bytes() for each in files)
            for _ in range(TURNS):
                flushed.append(_seconds(work))
                limit.append(_seconds(lambda raw=raw: _write_at_once(Path(place) / "at-once", raw)))
                with mock.patch.object(os, "fsync", lambda descriptor: None):
                    plain.append(_seconds(work))
            if path.is_dir():
                digested = [_seconds(lambda f=files: [content_digest(each, "motion") for each in f])]
            own = f"{digested[0]:.3f}" if digested else ""
            least, spent = median(limit), median(flushed)
            print(
                f"| {name} | {len(raw) / 1e6:.1f} | {spent:.3f} | {median(plain):.3f} | {own} | {least:.3f} | "
                f"{100 * least / spent:.0f} % |"
            )


if __name__ == "__main__":
    main()
