"""A task's networks on held-out windows: what the task makes of a window, and what a network makes of that."""

from __future__ import annotations

import numpy as np
import torch

from data_schemas.clips import ClipRow
from data_schemas.tpc import TpcReader
from stages.shared.inference.pose_model import PoseModel, blended
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.task import PoseTask, TaskBatch
from stages.shared.statistics.window_seeds import seed_words


def clean_windows(reader: TpcReader, clip: ClipRow, starts: list[int], window: int) -> BodyPose:
    """The true windows (B, T) of a clip that begin at some of its frames."""
    parts = [reader.transforms(clip.clip, start, start + window) for start in starts]
    roots = torch.from_numpy(np.stack([heads[:, 0] for heads, _ in parts])).float()
    return BodyPose(roots, torch.from_numpy(np.stack([rotations for _, rotations in parts])).float())


def window_random(seed: int, clip: ClipRow, start: int) -> np.random.Generator:
    """A generator that depends on the seed, the clip and the first frame alone, whatever else is measured."""
    return np.random.default_rng(seed_words(seed, clip.clip, start))


def task_batch(reader: TpcReader, task: PoseTask, clip: ClipRow, start: int, window: int, seed: int) -> TaskBatch:
    """One window (1, T) of a clip, as the task gives it to networks."""
    clean = clean_windows(reader, clip, [start], window)
    return task.draw(clean, torch.ones(1, window, dtype=torch.bool), [window_random(seed, clip, start)])


def made_of_batch(model: PoseModel | None, batch: TaskBatch) -> BodyPose:
    """The network's pose of a window (1, T), in windows of its training's length that are blended; or without a
    network the base."""
    if model is None:
        return batch.base

    def of_window(start: int, stop: int) -> BodyPose:
        part = slice(start, stop)
        times = torch.arange(float(stop - start)).unsqueeze(0)
        return model.pose(batch.features[:, part], batch.given[:, part], batch.base.frames(part), times)

    return blended(batch.valid.shape[1], max(model.window, 2), of_window)
