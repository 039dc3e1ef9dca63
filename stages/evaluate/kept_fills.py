"""Filled windows that an evaluation keeps: their size, which is bounded, and a batch of them for the artefact."""

from __future__ import annotations

from collections.abc import Iterable

from data_schemas.errors import InputError
from data_schemas.fills import BYTES_OF_A_JOINT, FilledBatch, kept_joints
from data_schemas.motion import MotionReader
from stages.evaluate.measured_clips import WindowBatch
from stages.shared.statistics.windows import Task, Window

MOST_BYTES = 4 << 30  # before compression, which halves them


def check_size(windows: Iterable[tuple[Window, int]], reader: MotionReader) -> None:
    """Raise InputError if the fills would take more than `MOST_BYTES`. windows: each with its number of motions."""
    total = 0
    for window, motions in windows:
        joints = len(kept_joints(reader.skeleton(reader.row(window.clip).skeleton)))
        total += motions * window.frames * joints * BYTES_OF_A_JOINT
    if total > MOST_BYTES:
        raise InputError(
            f"The filled windows would take {total / 1e9:.1f} GB, and at most {MOST_BYTES / 1e9:.1f} GB are kept.",
            "Measure fewer with --max-windows, or leave --keep-fills away.",
        )


def kept_batch(archive: str, task: Task, batch: WindowBatch) -> FilledBatch:
    """The batch as `data_schemas.fills` describes it."""
    return FilledBatch(
        number=0,
        archive=archive,
        task=task.name,
        interval=task.interval,
        skeleton=batch.skeleton_id,
        clips=tuple(window.clip for window in batch.windows),
        starts=tuple(window.start for window in batch.windows),
        known=batch.known,
    )
