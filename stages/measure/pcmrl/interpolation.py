"""PC-MRL Tables 1 and 3: a skeleton's own motions filled between keyframes, by plain interpolation and by
interpolators."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.metrics import MetricRow
from data_schemas.tpc import BoneSet, TpcReader
from stages.measure.pcmrl.config import Config
from stages.shared.inference.pose_filling import Interpolator
from stages.shared.kinematics.rotations import conjugate, rotate
from stages.shared.progress import Progress
from stages.shared.statistics.baselines import Filled, Poses, damped, lerp, slerp
from stages.shared.statistics.categories import category_of, named
from stages.shared.statistics.measurements import POWER_WEIGHTED, Measurements, Truth, measure
from stages.shared.statistics.tasks import INTERPOLATION
from stages.shared.statistics.windows import Task, Window, chosen_windows, clip_windows

PLAIN: dict[str, Callable[[Poses, np.ndarray], Filled]] = {"lerp": lerp, "slerp": slerp, "damped": damped}
_AT_ONCE = 32  # windows filled in one call
_HEADLINES = ("l2p_m", "l2q", "npss", "mpjpe_mm", "mpjae_deg")


@dataclass(frozen=True)
class _Batch:
    """Windows of one skeleton and one length: heads (B, T, J, 3), rotations (B, T, J, 4) on the bones of a cloud."""

    windows: tuple[Window, ...]
    bones: BoneSet
    heads: Tensor
    rotations: Tensor

    def poses(self) -> Poses:
        """For plain interpolation, which works on local rotations and offsets."""
        above = torch.as_tensor(self.bones.parents[1:], dtype=torch.long)
        steps = self.heads[:, :, 1:] - self.heads[:, :, above]
        offsets = rotate(conjugate(self.rotations[:, :, above]), steps)
        offsets = torch.cat([torch.zeros_like(offsets[:, :, :1]), offsets], dim=2)
        return Poses.from_joints(self.rotations, self.heads[:, :, 0], offsets, self.bones.parents)


def interpolation_rows(
    reader: TpcReader, interpolators: dict[str, Interpolator], config: Config, progress: Progress
) -> list[MetricRow]:
    """Every figure of every clip, by category, method and interval.

    Raises: InputError if no clip is long enough, or an interpolator is for another hierarchy.
    """
    plan = [
        (category, Task(INTERPOLATION, interval, config.window), windows)
        for category, by_interval in _windows(reader, config).items()
        for interval, windows in by_interval.items()
    ]
    if not plan:
        raise InputError(
            f"{reader.artefact.path} has no clip of the split {' or '.join(config.splits)} that is long enough.",
            "Name another split with --splits, or patterns that match with --category.",
        )
    methods = [*PLAIN, *interpolators]
    progress.start("filling windows", sum(len(windows) for *_, windows in plan) * len(methods))
    rows: list[MetricRow] = []
    for category, task, windows in plan:
        tally: dict[tuple[str, str, str], list[tuple[float, float]]] = defaultdict(list)
        for batch in _batches(reader, windows):
            for name, figures in _filled(batch, task, interpolators):
                for metric, (values, weights) in figures.items():
                    for window, value, weight in zip(batch.windows, values, weights, strict=True):
                        tally[window.clip, name, metric].append((float(value), float(weight)))
                progress.advance(len(batch.windows), f"{category}, {task.interval}, {name}")
        rows += [_row(reader, category, task, *key, np.array(pairs)) for key, pairs in tally.items()]
    return rows


def _windows(reader: TpcReader, config: Config) -> dict[str, dict[int, list[Window]]]:
    patterns = named("category", config.category)
    by_category: dict[str, list[tuple[str, int]]] = {name: [] for name in patterns}
    for row in sorted(reader.clips, key=lambda row: row.clip):
        category = category_of(row, patterns)
        if row.split in config.splits and category is not None and row.skeleton:
            by_category.setdefault(category, []).append((row.clip, row.frames))
    found: dict[str, dict[int, list[Window]]] = {}
    for category, clips in by_category.items():
        for interval in config.intervals:
            task = Task(INTERPOLATION, interval, config.window)
            windows = chosen_windows([clip_windows(*clip, task) for clip in clips], config.max_windows)
            if windows:
                found.setdefault(category, {})[interval] = windows
    return found


def _batches(reader: TpcReader, windows: list[Window]) -> Iterator[_Batch]:
    groups: dict[tuple[str, int], list[Window]] = {}
    for window in windows:
        groups.setdefault((reader.row(window.clip).skeleton, window.frames), []).append(window)
    for (skeleton, _), members in groups.items():
        for first in range(0, len(members), _AT_ONCE):
            part = tuple(members[first : first + _AT_ONCE])
            read = [reader.transforms(each.clip, each.start, each.start + each.frames) for each in part]
            heads, rotations = (torch.from_numpy(np.stack(parts)) for parts in zip(*read, strict=True))
            yield _Batch(part, reader.bones(skeleton), heads, rotations)


def _filled(batch: _Batch, task: Task, interpolators: dict[str, Interpolator]) -> Iterator[tuple[str, Measurements]]:
    """Every method's figures of a batch, on the bones that carry points."""
    known = task.known(batch.heads.shape[1])
    joints = np.flatnonzero(batch.bones.weights > 0)
    truth = Truth(batch.heads.numpy(), batch.rotations.numpy(), known, 0)
    poses = batch.poses()
    tails = torch.from_numpy(batch.bones.tails).expand(len(batch.windows), -1, 3)
    gate = torch.from_numpy(known).expand(len(batch.windows), -1)

    def figures(filled: Filled) -> Measurements:
        return {name: part for name, part in measure(*filled, truth, joints).items() if name in _HEADLINES}

    for name, function in PLAIN.items():
        yield name, figures(function(poses, known))
    for name, interpolator in interpolators.items():
        interpolator.check_hierarchy(batch.bones.parents, batch.bones.groups, batch.windows[0].clip)
        heads, rotations = interpolator.fill(batch.heads, batch.rotations, tails, gate)
        yield name, figures((heads.numpy(), rotations.numpy()))


def _row(
    reader: TpcReader, category: str, task: Task, clip: str, method: str, metric: str, pairs: np.ndarray
) -> MetricRow:
    values, weights = pairs.T
    total = weights.sum()
    return MetricRow(
        clip=clip,
        skeleton=reader.row(clip).skeleton,
        archive=category,
        method=method,
        task=INTERPOLATION,
        interval=task.interval,
        metric=metric,
        value=float((values * weights).sum() / total) if total > 0 else float(values.mean()),
        weight=float(total) if metric in POWER_WEIGHTED else 1.0,
        windows=len(values),
    )
