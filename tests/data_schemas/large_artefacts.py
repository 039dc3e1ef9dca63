"""Writers of one artefact of each kind: of 500 kB and more with size 2, and of a few kB with size 0."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.checkpoint import write_checkpoint
from data_schemas.latent import LatentWriter
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionWriter
from data_schemas.tpc import TpcWriter
from data_schemas.whole_file import write_whole
from tests.data_schemas.examples import a_motion, a_row, a_skeleton, some_bones, unit_quaternions


def _motion(path: Path, size: int) -> None:
    with write_artefact(path, "motion", stage="s", config={}) as draft, MotionWriter(draft.folder) as writer:
        skeleton = writer.add_skeleton(a_skeleton(8))
        for clip in range(8 * size or 1):
            frames = 300 if size else 5
            row = a_row(f"clip{clip}", skeleton=skeleton, frames=frames)
            writer.add_clip(row, a_motion(frames, 8, seed=clip))


def _cloud(path: Path, size: int, packed: bool) -> None:
    rng = np.random.default_rng(0)
    with (
        write_artefact(path, "tpc", stage="s", config={}) as draft,
        TpcWriter(draft.folder, packed=packed) as writer,
    ):
        bones = writer.add_bones(some_bones())
        for clip in range(30 * size or 1):
            frames = 400 if size else 5
            row = a_row(f"clip{clip}", skeleton=bones, frames=frames)
            writer.add_rigid(row, rng.normal(size=(frames, 2, 3)), unit_quaternions(rng, frames, 2))


def _latents(path: Path, size: int) -> None:
    rng = np.random.default_rng(0)
    with write_artefact(path, "latent", stage="s", config={}) as draft, LatentWriter(draft.folder, "e") as writer:
        for clip in range(4 * size or 1):
            frames = 300 if size else 5
            writer.add(a_row(f"clip{clip}", frames=frames), rng.normal(size=(frames, 64)), np.zeros((frames, 3)))


def _checkpoint(path: Path, size: int) -> None:
    weights = {"layer.weight": np.random.default_rng(0).normal(size=(300 * size + 1, 150))}
    with write_artefact(path, "checkpoint", stage="s", config={}) as draft:
        write_checkpoint(
            draft.folder, weights=weights, config={}, optimiser=None, log=[{"step": 1}], card="# A model\n"
        )


def _metrics(path: Path, size: int) -> None:
    values = np.random.default_rng(0).normal(size=40_000 * size + 1)
    rows = [MetricRow("walk", "s", "a", "slerp", "transition", 15, "l2p_m", float(value)) for value in values]
    with write_artefact(path, "metrics", stage="s", config={}) as draft:
        write_metrics(draft.folder, rows, "# Table\n")


def _file(path: Path, size: int) -> None:
    write_whole(path, np.random.default_rng(0).bytes(300_000 * size + 9))


WRITERS: dict[str, Callable[[Path, int], None]] = {
    "motion": _motion,
    "tpc": lambda path, size: _cloud(path, size, False),
    "packed": lambda path, size: _cloud(path, size, True),
    "latent": _latents,
    "checkpoint": _checkpoint,
    "metrics": _metrics,
    "file": _file,
}
