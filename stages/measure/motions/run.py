"""`pumps measure motions`: the distance of computed motions from the true motions of the same clips, on the same
joints."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.measure.motions.config import Config
from stages.shared.contract import StageReport
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.resampling import resample
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.measurements import POWER_WEIGHTED, Measurements, Truth, measure
from stages.shared.statistics.tables import cells, task_tables
from stages.shared.statistics.tasks import RECONSTRUCTION
from stages.shared.statistics.windows import Window, chosen_windows

_FRAMES_OFF = 2  # frames of tolerance: a clip's length is rounded twice
_SAME_M = 1e-3  # skeletons whose bones differ by less are the same


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure and write a `metrics` artefact.

    Raises: UsageError for a bad NAME=MOTION; InputError for bad artefacts, other joints, or no shared clip.
    """
    check_artefact(config, "metrics")
    with ExitStack() as opened:
        truth = opened.enter_context(MotionReader(config.truth))
        made = {name: opened.enter_context(MotionReader(path)) for name, path in _named(config.made).items()}
        windows, strange = _windows(truth, made, config)
        progress.start("measuring motions", len(windows) * len(made))
        rows = [row for name, reader in made.items() for row in _rows(truth, name, reader, windows, progress)]
        inputs = [truth.artefact, *(reader.artefact for reader in made.values())]
        page = (
            f"# Motions beside the true ones\n\nMade by:\n\n```\n{command_line('pumps measure motions', config)}\n"
            f"```\n\n{_left_out(strange)}\n\n{task_tables(cells(rows, config.seed))}"
        )
        figures = {"clips": len({row.clip for row in rows}), "windows": len(windows), "methods": list(made)}
        figures["left_out"] = strange
        with write_artefact(config.output, "metrics", stage="measure-motions", config=config, inputs=inputs) as draft:
            draft.summary.update(figures)
            write_metrics(draft.folder, rows, page)
    return StageReport(
        output=config.output,
        lines=[*_lines(rows), _left_out(strange), f"{config.output}, summary.md."],
        figures=figures,
    )


def _named(texts: Sequence[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value) or name in found:
            raise UsageError(f"--made {text!r} is not NAME=MOTION of its own.", "Write --made mine=runs/mine/decode.")
        found[name] = value
    if not found:
        raise UsageError("There is nothing to measure.", "Give --made NAME=MOTION.")
    return found


def _left_out(clips: Sequence[str]) -> str:
    if not clips:
        return "All shared clips are measured."
    count = "1 shared clip is" if len(clips) == 1 else f"{len(clips)} shared clips are"
    return f"{count} left out: the true motion is on another skeleton than the made one."


def _windows(
    truth: MotionReader, made: dict[str, MotionReader], config: Config
) -> tuple[list[tuple[ClipRow, Window]], list[str]]:
    """Windows of the clips that truth and all others have on the same joints, in frames of the computed motions; and
    the clips that are on other joints."""
    first = next(iter(made.values()))
    shared = set.intersection(*({row.clip for row in reader.clips} for reader in made.values()))
    by_archive: dict[str, list[list[Window]]] = defaultdict(list)
    rows = {row.clip: row for row in truth.clips if row.split in config.splits and row.clip in shared}
    strange = sorted(clip for clip in rows if not all(_alike(truth, reader, clip) for reader in made.values()))
    rows = {clip: row for clip, row in rows.items() if clip not in strange}
    for clip in sorted(rows):
        frames = min(reader.row(clip).frames for reader in made.values())
        size = min(config.window, frames)
        starts = np.linspace(0, frames - size, frames // size).astype(int)
        by_archive[archive_of(rows[clip])].append([Window(clip, int(start), size) for start in starts])
    chosen = [window for clips in by_archive.values() for window in chosen_windows(clips, config.max_windows)]
    if not chosen:
        raise InputError(
            f"{truth.artefact.path} and {first.artefact.path} share no clip of {' or '.join(config.splits)} "
            "on the same joints.",
            "Give --splits; `pumps measure pcmrl` compares motions on different joints, as clouds.",
        )
    return [(rows[window.clip], window) for window in chosen], strange


def _alike(truth: MotionReader, made: MotionReader, clip: str) -> bool:
    one, two = (reader.skeleton(reader.row(clip).skeleton) for reader in (truth, made))
    return one.names == two.names and bool(np.allclose(one.tails, two.tails, atol=_SAME_M))


def _rows(
    truth: MotionReader, name: str, made: MotionReader, windows: list[tuple[ClipRow, Window]], progress: Progress
) -> Iterator[MetricRow]:
    by_clip: dict[str, list[Window]] = defaultdict(list)
    for _, window in windows:
        by_clip[window.clip].append(window)
    for clip, mine in by_clip.items():
        skeleton, pair = _pair(truth, made, clip)
        found = [_measurements(skeleton, *pair, window) for window in mine]
        progress.advance(len(mine), f"{name}, {clip}")
        for metric in found[0]:
            values, weights = (np.array([each[metric][part][0] for each in found]) for part in (0, 1))
            total = weights.sum()
            yield MetricRow(
                clip=clip,
                skeleton=truth.row(clip).skeleton,
                archive=archive_of(truth.row(clip)),
                method=name,
                task=RECONSTRUCTION,
                interval=0,
                metric=metric,
                value=float((values * weights).sum() / total) if total > 0 else float(values.mean()),
                weight=float(total) if metric in POWER_WEIGHTED else 1.0,
                windows=len(mine),
            )


def _pair(truth: MotionReader, made: MotionReader, clip: str) -> tuple[Skeleton, tuple[Motion, Motion]]:
    """The clip's skeleton, its true motion at the computed one's rate, and the computed motion.

    Raises: InputError if their lengths differ.
    """
    skeleton, motion = truth.skeleton(truth.row(clip).skeleton), made.motion(clip)
    true = resample(truth.motion(clip), motion.fps)
    if abs(true.frames - motion.frames) > _FRAMES_OFF:
        raise InputError(
            f"The clip {clip!r} of {made.artefact.path} has {motion.frames} frames, the true one {true.frames}.",
            "Make it again from the same clip.",
        )
    return skeleton, (true, motion)


def _measurements(skeleton: Skeleton, true: Motion, made: Motion, window: Window) -> Measurements:
    """On the joints that carry points."""
    part = slice(window.start, min(window.start + window.frames, true.frames, made.frames))
    both = [(positions_of(skeleton, motion)[None, part], motion.rotations[None, part]) for motion in (true, made)]
    known = np.ones(both[0][0].shape[1], bool)
    truth = Truth(*both[0], known, skeleton.root)
    return measure(*both[1], truth, np.flatnonzero(skeleton.sampled))


def _lines(rows: Sequence[MetricRow]) -> list[str]:
    lines = []
    for method in dict.fromkeys(row.method for row in rows):
        mine = [row for row in rows if row.method == method]
        shown = []
        for metric in ("mpjpe_mm", "mpjve_mm", "mpjae_deg"):
            picked = [row for row in mine if row.metric == metric]
            shown.append(f"{metric} {np.average([r.value for r in picked], weights=[r.windows for r in picked]):.2f}")
        lines.append(f"{method}: {', '.join(shown)}, mean over windows.")
    return lines
