"""Whole-file edits behind the methods of `Motion`: what `pumps edit` does, from Python."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from data_schemas.errors import UsageError
from stages.shared.threads import one_thread_if_they_spin

if TYPE_CHECKING:
    from pumps.motion import Motion
    from stages.shared.editing.motion_files import MotionFile

Weights = str | os.PathLike[str] | None


def trim(motion: Motion, first: int, stop: int | None) -> Motion:
    from stages.shared.editing.timing import range_of_frames, trimmed

    text = f"{first}:" if stop is None else f"{first}:{stop}"
    return _edited(motion, trimmed(motion.record, range_of_frames(text, motion.frames)))


def resample(motion: Motion, fps: float) -> Motion:
    from stages.shared.editing.timing import resampled

    return _edited(motion, resampled(motion.skeleton, motion.record, fps))


def mirror(motion: Motion, across: str) -> Motion:
    import numpy as np

    from stages.shared.editing.edited import NONE, Edited
    from stages.shared.editing.mirror import mirror_of, mirrored

    if across not in ("auto", "x", "z"):
        raise UsageError(f"across is {across!r}.", 'Give "x", "z" or "auto".')
    found = mirror_of(motion.skeleton, motion.record, across)
    made = Edited.of(mirrored(motion.skeleton, motion.record, found), np.full(motion.frames, NONE))
    return _edited(motion, made, mirror=found)


def smooth(motion: Motion, seconds: float, method: str) -> Motion:
    from stages.shared.editing.smooth import smoothed

    return _edited(motion, smoothed(motion.skeleton, motion.record, seconds, method=method))


@one_thread_if_they_spin()
def loop(motion: Motion, seconds: float | None, weights: Weights, seed: int, device: str) -> Motion:
    from stages.shared.editing.bridging import looped

    found = looped(motion.skeleton, motion.record, _models(weights, device), seconds=seconds, seed=seed)
    return _edited(motion, found.edited, notes=found.speeds)


@one_thread_if_they_spin()
def join(motion: Motion, then: Motion, seconds: float, weights: Weights, seed: int, device: str) -> Motion:
    from stages.shared.editing.bridging import check_one_rig, joined

    check_one_rig(motion.skeleton, then.skeleton, (motion.name, then.name))
    models = _models(weights, device)
    found = joined(motion.skeleton, motion.record, then.record, models, seconds=seconds, seed=seed)
    text = _file_of(motion).with_rows_of(_file_of(then)) if motion.source and then.source else None
    return _edited(motion if text else replace(motion, source=b""), found.edited, notes=found.speeds, file=text)


def _models(weights: Weights, device: str) -> Callable[[], Any]:
    from stages.shared.inference.kept_models import kept_models
    from stages.shared.weights.shipped import default_weights

    return lambda: kept_models(os.fspath(weights or default_weights()), device)


def _file_of(motion: Motion) -> MotionFile:
    """The BVH that a motion was read from, or no text where there is none."""
    from stages.shared.editing.motion_files import MotionFile
    from stages.shared.formats.bvh import read_bvh

    bvh = read_bvh(motion.source, motion.name) if motion.source else None
    return MotionFile(motion.name, motion.skeleton, motion.record, bvh=bvh)


def _edited(
    motion: Motion, edited: Any, *, mirror: Any = None, notes: tuple[str, ...] = (), file: MotionFile | None = None
) -> Motion:
    """The result as a Motion, with the text of its BVH where the motion has one."""
    from pathlib import Path

    source, losses = b"", list[str]()
    if motion.source:
        source, losses = (file or _file_of(motion)).written(Path("edited.bvh"), edited, mirror=mirror)
    return replace(motion, record=edited.motion, notes=(*notes, *edited.notes, *losses), source=source)
