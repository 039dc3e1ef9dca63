"""`pumps measure constraints`: windows filled with and without what is known of their missing frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.measure.constraints.cases import asked_of, compared_joints
from stages.measure.constraints.config import Config
from stages.measure.constraints.summary import CONSTRAINED, FREE, PLAIN, summary_md, terminal_lines
from stages.shared.contract import StageReport
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.constraints.fixed import Fixed, fixed_of
from stages.shared.inference.constraints.known_parts import KnownParts, known_parts
from stages.shared.inference.filling import FillOptions, fill_motion, start_from
from stages.shared.inference.models import Models, load_weights
from stages.shared.inference.pinned_ends import pin_ends
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.resampling import resample, resampled_frames
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.metrics import mpjae_deg, mpjpe_mm
from stages.shared.statistics.rig_windows import windows_by_category
from stages.shared.statistics.window_seeds import window_seed
from stages.shared.weights.shipped import parts_of, weights_folder

OPTIONS = FillOptions(foot_lock=True)


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure and write a `metrics` artefact.

    Raises: InputError for a bad artefact or weights that are not there, and where no clip is long enough.
    """
    check_artefact(config, "metrics")
    artefact = open_artefact(config.motion, "motion")
    weights = [open_artefact(part, "checkpoint") for part in parts_of(weights_folder(config.weights))]
    models = load_weights(config.weights, config.device)
    rows: list[MetricRow] = []
    unreachable = 0
    with MotionReader(artefact) as reader:
        windows = _windows(reader, config)
        progress.start("filling", sum(len(starts) for *_, starts in windows))
        for category, clip, starts in windows:
            skeleton, whole = reader.skeleton(clip.skeleton), resample(reader.motion(clip.clip), MODEL_FPS)
            for start in starts:
                truth = whole.at(slice(start, start + config.window))
                found = list(_measured(skeleton, truth, clip, category, start, models, config))
                unreachable += sum(row.metric == _UNREACHABLE for row in found)
                rows += [row for row in found if row.metric != _UNREACHABLE]
                progress.advance(1, f"{category}, {clip.clip}")
    count = sum(len(starts) for *_, starts in windows)
    figures = {"windows": count, "clips": len({clip.clip for _, clip, _ in windows}), "out_of_reach": unreachable}
    inputs = [artefact, *weights]
    with write_artefact(config.output, "metrics", stage="measure-constraints", config=config, inputs=inputs) as draft:
        draft.summary.update(figures)
        write_metrics(draft.folder, rows, summary_md(config, rows, models, figures))
    lines = [*terminal_lines(rows, config), f"Full tables: {config.output}, summary.md."]
    return StageReport(output=config.output, lines=lines, figures=figures)


_UNREACHABLE = "out_of_reach"


def _windows(reader: MotionReader, config: Config) -> list[tuple[str, ClipRow, list[int]]]:
    """Windows at 30 frames a second, by category."""
    clips = [replace(row, frames=resampled_frames(row.frames, row.fps, MODEL_FPS)) for row in reader.clips]
    categories = config.category or tuple(f"{name}=*{name}*" for name in sorted({archive_of(row) for row in clips}))
    rigs = {row.skeleton for row in clips}
    measured = (config.splits, categories, config.window, config.max_windows, config.motion)
    return list(windows_by_category(clips, rigs, *measured))


def _measured(
    skeleton: Skeleton, truth: Motion, clip: ClipRow, category: str, start: int, models: Models, config: Config
) -> Iterator[MetricRow]:
    """The figures of a window; a row `out_of_reach` for each constraint that the body cannot meet."""
    seed = window_seed(config.seed, clip.clip, start)
    free: Motion | None = None
    for constraint in config.constraints:
        asked = asked_of(constraint, skeleton, truth, config.interval)
        parts = known_parts(asked, skeleton, truth.frames)  # its whole keys are the same with every constraint
        motion, fixed, _ = fixed_of(asked, skeleton, without_answers(skeleton, truth, parts), parts)
        known = parts.whole
        if free is None:
            keys_alone = without_answers(skeleton, truth, KnownParts.of_frames(known, skeleton.joints))
            free = fill_motion(
                skeleton, keys_alone, known, SynthesisedClouds(models), seed=seed, options=OPTIONS,
                device=models.autoencoder.device,
            ).motion  # fmt: skip
        place = (clip.clip, clip.skeleton, category)
        try:
            filled = fill_motion(
                skeleton, motion, known, SynthesisedClouds(models), seed=seed, options=OPTIONS,
                device=models.autoencoder.device, fixed=fixed,
            )  # fmt: skip
            plain = _plain(skeleton, motion, known, fixed, models)
        except InputError:
            yield MetricRow(*place, CONSTRAINED, constraint, config.interval, _UNREACHABLE, 1.0)
            continue
        joints = compared_joints(constraint, skeleton)
        for method, made in ((PLAIN, plain), (FREE, free), (CONSTRAINED, filled.motion)):
            for metric, value in _errors(skeleton, made, truth, ~known, joints).items():
                yield MetricRow(*place, method, constraint, config.interval, metric, value)
        for off_m in filled.pins_off_m.values():
            yield MetricRow(*place, CONSTRAINED, constraint, config.interval, "pin_off_mm", off_m * 1000)


def without_answers(skeleton: Skeleton, truth: Motion, parts: KnownParts) -> Motion:
    """The motion with arbitrary values where nothing is given.

    Joints of frames that are given in part are seen through their rotations in their parents alone.
    """
    empty = ~(parts.joints.any(axis=1) | parts.position)
    rotations, roots, tracks = (np.array(part) for part in (truth.rotations, truth.root_positions, truth.tracks))
    rotations[empty], roots[empty] = [0, 0, 0, 1], 0
    if len(truth.track_joints):
        tracks[empty] = 0
    return replace(truth, rotations=rotations, root_positions=roots, tracks=tracks)


def _plain(skeleton: Skeleton, motion: Motion, known: np.ndarray, fixed: Fixed, models: Models) -> Motion:
    """The plain interpolation under the same constraints."""
    start = start_from(skeleton, motion, known, SynthesisedClouds(models), options=OPTIONS, fixed=fixed)
    pose = start.given.with_rows(np.flatnonzero(~known), start.base)
    return pin_ends(pose, fixed, known, motion.fps)[0].motion(motion.fps)


def _errors(
    skeleton: Skeleton, made: Motion, truth: Motion, missing: np.ndarray, joints: np.ndarray
) -> dict[str, float]:
    """Errors of some joints in the missing frames."""
    places = [positions_of(skeleton, each)[missing][:, joints][None] for each in (made, truth)]
    turns = [each.rotations[missing][:, joints][None].astype(np.float64) for each in (made, truth)]
    return {"mpjpe_mm": float(mpjpe_mm(*places)[0]), "mpjae_deg": float(mpjae_deg(*turns)[0])}
