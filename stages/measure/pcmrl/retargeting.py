"""PC-MRL Table 2: similarity of an adapted motion and its source, as clouds and at the ends of the limbs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.metrics import MetricRow
from data_schemas.skeleton import BODY_GROUPS
from data_schemas.tpc import BoneSet, TpcReader
from stages.measure.pcmrl.config import Config
from stages.shared.pointcloud.drawn_points import drawn_on_bones
from stages.shared.pointcloud.knn_loss import nearest_trajectories
from stages.shared.pointcloud.sampling import draw_points
from stages.shared.progress import Progress
from stages.shared.statistics.categories import category_of, named
from stages.shared.statistics.tasks import RETARGETING
from stages.shared.statistics.window_seeds import seed_words
from stages.shared.statistics.windows import Window, chosen_windows

ORIGINAL = "original motion"
_CENTIMETRES = 100.0

Moving = tuple[BoneSet, Tensor, Tensor]
"""Bones with their heads (T, J, 3) and global rotations (T, J, 4)."""


def retargeting_rows(
    source: TpcReader, adapted: dict[str, TpcReader], config: Config, progress: Progress
) -> list[MetricRow]:
    """L_KNN at every sigma and L_end, of every clip of the source and every adaptation of it.

    Raises: InputError if no clip is long enough, or none was adapted.
    """
    windows = _windows(source, adapted, config)
    progress.start("comparing clouds", len(windows))
    found: dict[tuple[str, str, str, str, int], list[float]] = {}
    for category, window in windows:
        truth = _read(source, window)
        others = {name: _read(reader, window) for name, reader in adapted.items()}
        for (method, metric, sigma_mm), value in _measurements(truth, others, window, config):
            found.setdefault((category, window.clip, method, metric, sigma_mm), []).append(value)
        progress.advance(1, window.clip)
    return [
        MetricRow(
            clip=clip,
            skeleton=source.row(clip).skeleton,
            archive=category,
            method=method,
            task=RETARGETING,
            interval=sigma_mm,
            metric=metric,
            value=float(np.mean(values)),
            windows=len(values),
        )
        for (category, clip, method, metric, sigma_mm), values in found.items()
    ]


def _windows(source: TpcReader, adapted: dict[str, TpcReader], config: Config) -> list[tuple[str, Window]]:
    """Windows of source clips that all adaptations contain, with their categories."""
    shared = set.intersection(*({row.clip for row in reader.clips} for reader in adapted.values()))
    patterns = named("category", config.category)
    clips: dict[str, list[list[Window]]] = {}
    for row in sorted(source.clips, key=lambda row: row.clip):
        category = category_of(row, patterns)
        if row.split not in config.splits or row.clip not in shared or row.frames < config.window or category is None:
            continue
        starts = np.linspace(0, row.frames - config.window, row.frames // config.window).astype(int)
        clips.setdefault(category, []).append([Window(row.clip, int(start), config.window) for start in starts])
    windows = [(name, window) for name, each in clips.items() for window in chosen_windows(each, config.max_windows)]
    if not windows:
        raise InputError(
            f"{source.artefact.path} has no clip of {config.window} frames in the split "
            f"{' or '.join(config.splits)} that was adapted.",
            "Adapt that split: pumps decode --method network --splits.",
        )
    return windows


def _read(reader: TpcReader, window: Window) -> Moving:
    bones = reader.bones(reader.row(window.clip).skeleton)
    heads, rotations = reader.transforms(window.clip, window.start, window.start + window.frames)
    return bones, torch.from_numpy(heads), torch.from_numpy(rotations)


def _measurements(
    truth: Moving, others: dict[str, Moving], window: Window, config: Config
) -> Iterator[tuple[tuple[str, str, int], float]]:
    """((method, metric, sigma in mm), value) of a window, in centimetres; L_end has sigma 0."""
    seed = seed_words(config.seed, window.clip, window.start)
    cloud, groups = _clouds(truth, config, [*seed, 0])
    compared = {ORIGINAL: truth, **others}
    for number, (name, moving) in enumerate(compared.items()):
        other, other_groups = _clouds(moving, config, [*seed, 1 + number])
        for sigma, one, two in zip(config.sigmas_m, cloud, other, strict=True):
            near = nearest_trajectories(
                one[None], two[None], groups[None], other_groups[None], count=config.neighbours
            )
            yield (name, "knn_cm", round(1000 * sigma)), _CENTIMETRES * float(near.means())
        yield (name, "end_cm", 0), _CENTIMETRES * end_distance(truth, moving)


def _clouds(moving: Moving, config: Config, seed: Sequence[int]) -> tuple[list[Tensor], Tensor]:
    """The same draw of points scattered by every sigma, (T, P, 3) each, and the points' groups (P,)."""
    bones, heads, rotations = moving
    draw = draw_points(bones.weights, config.points, np.random.default_rng(seed))
    drawn = drawn_on_bones(map(torch.from_numpy, draw), bones.groups, bones.tails, 0.0)
    return [replace(drawn, sigma_m=sigma).place(heads, rotations) for sigma in config.sigmas_m], drawn.groups


def end_distance(one: Moving, other: Moving) -> float:
    """L_end (PC-MRL eq. 6) over the pairs: mean distance in time of heads, wrists and ankles, metres.

    Eq. 6 sums the pairs; here it is their mean, so that a skeleton without some of them can be measured.
    """
    ends, expected = (_ends(moving) for moving in (one, other))
    there = [group for group in ends if group in expected]
    return float(np.mean([float((ends[group] - expected[group]).norm(dim=-1).mean()) for group in there]))


def _ends(moving: Moving) -> dict[str, Tensor]:
    """By body group, the position where the bone of the head, a hand or a foot begins, (T, 3): the end of the lower
    one of a limb's two longest bones, so that toes make no difference; the spine's last bone is the head."""
    bones, heads, _ = moving
    lengths = np.linalg.norm(bones.tails, axis=1)
    ends: dict[str, Tensor] = {}
    for group, name in enumerate(BODY_GROUPS):
        mine = np.flatnonzero((bones.groups == group) & (bones.weights > 0))
        if len(mine) == 0:
            continue
        if name == "spine":
            ends[name] = heads[:, mine[-1]]
            continue
        lower = int(np.sort(mine[np.argsort(-lengths[mine], kind="stable")[:2]])[-1])
        below = np.flatnonzero(bones.parents == lower)
        if len(below):
            ends[name] = heads[:, below[0]]
    return ends
