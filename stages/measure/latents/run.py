"""`pumps measure latents`: encode the same motion with many changes, and measure how far its latents move."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError
from data_schemas.manifest import MANIFEST_NAME, open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader, skeleton_id
from stages.measure.latents.changes import (
    Change,
    Encoded,
    OriginalWindow,
    changes,
    original_window,
    spread_evenly,
    unchanged,
)
from stages.measure.latents.config import Config
from stages.measure.latents.summary import LatentResults, summary_md, terminal_lines
from stages.shared.contract import StageReport
from stages.shared.humanoid.rig_changes import Rigged
from stages.shared.inference.measured_clouds import redraw_on_window
from stages.shared.inference.models import Autoencoder, load_autoencoder
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.resampling import resample, resampled_frames
from stages.shared.outputs import check_artefact
from stages.shared.pointcloud.assignment import paired_difference
from stages.shared.pointcloud.reconstruction import distances
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.windows import Window, chosen_windows
from stages.shared.weights.shipped import weights_folder

TASK = "latents"
BASE = "unchanged"
_NEAR = 1  # distance in frames that still counts as found


@dataclass(frozen=True)
class EncodedWindow:
    """A window before any change: latents (T, D) and centroids (T, 3), and the latents of points spread evenly."""

    original: OriginalWindow
    truth: Encoded
    latents: Tensor
    centroids: Tensor
    spread_latents: Tensor


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure how latents move under every change, on held-out windows; write a `metrics` artefact.

    Raises: InputError for bad artefacts, or if no clip of the wanted splits is long enough.
    """
    check_artefact(config, "metrics")
    autoencoder, source = _load(config)
    with MotionReader(config.motion) as reader:
        originals = _original_windows(reader, config, config.points or autoencoder.points)
        others = _other_skeletons(reader, originals)
        inputs = [reader.artefact, open_artefact(source, "checkpoint")]
    rows_of = changes(others)
    progress.start("encoding", len(originals) * (len(rows_of) + 1))
    bases = []
    for original in originals:
        bases.append(_base(original, autoencoder, config.seed))
        progress.advance(1, BASE)
    book = _Book(bases)
    figures: dict[str, list[dict[str, float]]] = defaultdict(list)
    for number, base in enumerate(bases):
        noise = autoencoder.draw_noise(len(base.truth.groups), config.seed)
        decoded = _decoded(autoencoder, base, base.truth, base.latents, base.centroids, noise, True)
        figures[BASE].append(decoded | _level(base, config.seed))
        for place, change in enumerate(rows_of):
            rng = base.original.seed(config.seed, place + 2)
            figures[change.name].append(_measurements(autoencoder, book, number, change, rng, noise))
            progress.advance(1, change.name)
    rows = [row for name, values in figures.items() for row in _rows(name, originals, values, config.window)]
    measured = LatentResults(config, rows_of, rows, originals[0].points, len(originals))
    with write_artefact(config.output, "metrics", stage="measure-latents", config=config, inputs=inputs) as draft:
        draft.summary.update(windows=len(originals), changes=[change.name for change in rows_of])
        write_metrics(draft.folder, rows, summary_md(measured))
    return StageReport(
        output=config.output,
        lines=[*terminal_lines(measured), f"The whole table: {config.output}, summary.md."],
        figures={"windows": len(originals), "changes": [change.name for change in rows_of]},
    )


class _Book:
    """All windows' latents before any change: the set in which a changed latent is looked up, and the distances
    within it."""

    def __init__(self, bases: Sequence[EncodedWindow]):
        self.bases = bases
        self.all = torch.cat([base.latents for base in bases])
        self.all_spread = torch.cat([base.spread_latents for base in bases])
        self.window = torch.cat([torch.full((len(base.latents),), number) for number, base in enumerate(bases)])
        self.middle = self.all.mean(0)
        # Root-mean-square distance of two frames drawn at random: from all windows, and from the same window.
        self.apart = _apart(self.all)
        self.apart_within = float(np.sqrt(np.mean([_apart(base.latents) ** 2 for base in bases])))


def _apart(latents: Tensor) -> float:
    return float((2 * latents.var(0, unbiased=True).sum()).sqrt())


def _load(config: Config) -> tuple[Autoencoder, Path]:
    """The autoencoder of shipped weights, of a run's folder, or of a checkpoint's own folder."""
    given = Path(config.weights)
    if (given / MANIFEST_NAME).is_file():
        return load_autoencoder(given, config.device), given
    folder = weights_folder(config.weights)
    name = "ae" if (folder / "ae" / MANIFEST_NAME).is_file() else "train-ae"
    return load_autoencoder(folder / name, config.device), folder / name


def _original_windows(reader: MotionReader, config: Config, points: int) -> list[OriginalWindow]:
    """Windows of the wanted clips at the models' rate, spread evenly over each archive's clips."""
    by_archive: dict[str, list[list[Window]]] = defaultdict(list)
    for row in sorted(reader.clips, key=lambda row: (archive_of(row), row.clip)):
        frames = resampled_frames(row.frames, row.fps, MODEL_FPS)
        if row.split in config.splits and frames >= config.window:
            starts = np.linspace(0, frames - config.window, frames // config.window).astype(int)
            by_archive[archive_of(row)].append([Window(row.clip, int(start), config.window) for start in starts])
    chosen = [window for clips in by_archive.values() for window in chosen_windows(clips, config.max_windows)]
    if not chosen:
        raise InputError(
            f"{config.motion} has no clip of {config.window} frames at 30 a second in the split "
            f"{' or '.join(config.splits)}.",
            "Name another split with --splits, or measure shorter windows with --window.",
        )
    return [_original_window(reader, window, config, points) for window in chosen]


def _original_window(reader: MotionReader, window: Window, config: Config, points: int) -> OriginalWindow:
    row = reader.row(window.clip)
    motion = resample(reader.motion(window.clip), MODEL_FPS).at(window.span)
    rigged = Rigged(reader.skeleton(row.skeleton), motion)
    return original_window(row, window.start, rigged, points, config.sigma_m, config.seed)


def _other_skeletons(reader: MotionReader, originals: Sequence[OriginalWindow]) -> dict[str, Rigged]:
    """If several skeletons are measured: the first of each archive, with the poses of its first clip."""
    found: dict[str, Rigged] = {}
    for original in originals:
        if archive_of(original.row) not in found:
            poses = resample(reader.motion(original.row.clip), MODEL_FPS)
            found[archive_of(original.row)] = Rigged(original.rigged.skeleton, poses)
    kinds = {skeleton_id(each.skeleton): name for name, each in reversed(found.items())}
    return {name: found[name] for name in sorted(kinds.values())} if len(kinds) > 1 else {}


def _base(original: OriginalWindow, autoencoder: Autoencoder, seed: int) -> EncodedWindow:
    truth = unchanged(original)
    latents, centroids = _encoded(autoencoder, truth)
    spread, _ = _encoded(autoencoder, spread_evenly(original, original.bones, original.seed(seed, 1)))
    return EncodedWindow(original, truth, latents, centroids, spread)


def _encoded(autoencoder: Autoencoder, what: Encoded) -> tuple[Tensor, Tensor]:
    """Latents (T, D) and centroids (T, 3), on the CPU."""
    latents, centroids = autoencoder.encode(what.cloud, what.groups)
    return latents.cpu(), centroids.cpu()


def _measurements(
    autoencoder: Autoencoder, book: _Book, number: int, change: Change, rng: np.random.Generator, noise: Tensor
) -> dict[str, float]:
    base = book.bases[number]
    changed = change.apply(base.original, rng)
    if changed is None:
        return {}
    latents, centroids = _encoded(autoencoder, changed)
    from_, anywhere = (base.spread_latents, book.all_spread) if changed.spread else (base.latents, book.all)
    moved = float((latents - from_).square().sum(-1).mean().sqrt())
    figures = {"move_window": moved / book.apart_within, "move_any": moved / book.apart}
    centred, before = latents - book.middle, from_ - book.middle
    figures["cosine"] = float(torch.nn.functional.cosine_similarity(centred, before, dim=-1).mean())
    nearest = torch.cdist(latents, from_).argmin(1)
    off = (nearest - torch.arange(len(latents))).abs()
    figures |= {"frames_off": float(off.float().mean()), "found": float((off <= _NEAR).float().mean())}
    figures["same_window"] = float((book.window[torch.cdist(latents, anywhere).argmin(1)] == number).float().mean())
    return figures | _decoded(autoencoder, base, changed, latents, centroids, noise, change.same_cloud)


def _decoded(
    autoencoder: Autoencoder,
    base: EncodedWindow,
    changed: Encoded,
    latents: Tensor,
    centroids: Tensor,
    noise: Tensor,
    same_cloud: bool,
) -> dict[str, float]:
    """Distance of the cloud decoded from changed latents from the changed cloud (`own`) and, if this is another draw
    of the base's cloud, from the base's cloud (`cross`)."""
    times = torch.arange(len(latents), dtype=torch.float32)
    figures: dict[str, float] = {}
    targets = [("own", changed.cloud, changed.groups)]
    if same_cloud:
        targets.append(("cross", base.truth.cloud, base.truth.groups))
    for name, cloud, groups in targets:
        seeds = noise if len(noise) == len(groups) else autoencoder.draw_noise(len(groups), base.original.start)
        made = autoencoder.decode(latents, centroids, times, groups, seeds).cpu()
        apart = paired_difference(made.unsqueeze(0), cloud.unsqueeze(0), groups.unsqueeze(0))
        whole, moving, _ = distances(apart)
        figures |= {f"{name}_mm": 1000 * float(whole), f"{name}_moving_mm": 1000 * float(moving)}
    return figures


def _level(base: EncodedWindow, seed: int) -> dict[str, float]:
    """Distance of another draw of the base's cloud from it: the part of the decoded clouds' distance that is not an
    error."""
    original, groups = base.original, base.truth.groups
    other = original.bones.cloud(redraw_on_window(original.bones, groups, original.seed(seed, 0), original.sigma_m))
    apart = paired_difference(other.unsqueeze(0), base.truth.cloud.unsqueeze(0), groups.unsqueeze(0))
    whole, moving, _ = distances(apart)
    return {"level_mm": 1000 * float(whole), "level_moving_mm": 1000 * float(moving)}


def _rows(
    change: str, originals: Sequence[OriginalWindow], figures: Sequence[dict[str, float]], frames: int
) -> Iterator[MetricRow]:
    by_clip: dict[str, list[int]] = defaultdict(list)
    for index, original in enumerate(originals):
        by_clip[original.row.clip].append(index)
    for metric in dict.fromkeys(metric for each in figures for metric in each):
        for clip_members in by_clip.values():
            members = [index for index in clip_members if metric in figures[index]]
            if not members:
                continue
            row = originals[members[0]].row
            value = float(np.mean([figures[index][metric] for index in members]))
            place = (row.clip, row.skeleton, archive_of(row))
            yield MetricRow(*place, change, TASK, frames, metric, value, windows=len(members))
