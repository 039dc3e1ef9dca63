"""`pumps weights vary`: measure the residuals that true motions leave to what weights fill, and fit their
distribution."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import torch

from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.contract import StageReport
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.models import Models, load_weights
from stages.shared.inference.token_times import choose_tokens
from stages.shared.inference.variation import write_variation
from stages.shared.inference.varied_clouds import drawn_evenly, encoded_gap, gap_view
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.resampling import resample
from stages.shared.outputs import check_written
from stages.shared.progress import SILENT, Progress
from stages.shared.solve.skeleton_pose import pose_of_motion
from stages.shared.statistics.windows import planned_windows, tasks_of
from stages.shared.weights.shipped import VARIATION_NAME, weights_folder
from stages.weights.vary.config import Config
from stages.weights.vary.fit import Residual, fit_variation


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Fit the variation and write it beside the weights.

    Raises: InputError for bad weights or motions, or if no clip of the splits is long enough.
    """
    path = weights_folder(config.weights) / VARIATION_NAME
    check_written(config, path, "weights")
    models = load_weights(config.weights, config.device)
    residuals: list[Residual] = []
    licences: set[str] = set()
    with ExitStack() as opened:
        readers = [opened.enter_context(MotionReader(each)) for each in config.motion]
        tasks = tasks_of(config.intervals, config.transitions, config.predictions, config.window)
        plan = [
            (reader, *each)
            for reader in readers
            for each in planned_windows(reader.clips, config.splits, tasks, config.max_windows, config.seed)
        ]
        progress.start("filling", len(plan))
        for reader, archive, task, window in plan:
            row = reader.row(window.clip)
            truth = resample(reader.motion(row.clip), MODEL_FPS).at(window.span)
            known = task.known(window.frames)
            residuals += _residuals(config, models, reader.skeleton(row.skeleton), truth, known, archive)
            licences.add(row.licence)
            progress.advance(1, row.clip)
    if not residuals:
        raise InputError(
            f"{', '.join(map(str, config.motion))} has no clip of the split {' or '.join(config.splits)} that is "
            "long enough.",
            "Name another with --splits.",
        )
    variation = fit_variation(residuals, models.autoencoder.digest)
    archives = sorted({each.archive for each in residuals})
    about: dict[str, object] = {"windows": len(plan), "gaps": len(residuals), "archives": archives}
    about |= {"splits": list(config.splits), "licences": sorted(licences)}
    write_variation(path, variation, about)
    lines = [
        f"{len(residuals)} gaps in {len(plan)} windows of {len(archives)} archives; kept in {path}.",
        f"log s = {_terms(variation.scale[0])} between two keys, {_terms(variation.scale[1])} after one.",
    ]
    figures = {"windows": len(plan), "gaps": len(residuals), "scale": variation.scale.tolist()}
    return StageReport(lines=lines, figures=figures)


def _terms(weights: np.ndarray) -> str:
    constant, lone, length, speed = weights
    return f"{constant:.2f} {lone:+.2f} lone {length:+.2f} log length {speed:+.2f} log speed"


def _residuals(
    config: Config, models: Models, skeleton: Skeleton, truth: Motion, known: np.ndarray, archive: str
) -> Iterator[Residual]:
    """The residuals of a window's gaps, at the models' rate."""
    filled = fill_motion(
        skeleton, truth, known, SynthesisedClouds(models), points=config.points, seed=config.seed,
        device=models.autoencoder.device, options=FillOptions(foot_lock=True),
    ).motion  # fmt: skip
    device, coder = models.autoencoder.device, models.autoencoder
    tokens = choose_tokens(np.flatnonzero(known), truth.frames, truth.fps)
    with torch.no_grad():
        fill, true = (pose_of_motion(skeleton, each, device) for each in (filled, truth))
        drawn = drawn_evenly(coder, skeleton, FillOptions().sigma_m, device)
        for gap in tokens.gaps():
            view = gap_view(fill, tokens, gap, drawn, context=1)
            there, wanted = (encoded_gap(coder, pose, view, drawn) for pose in (fill, true))
            inside = torch.as_tensor(gap - view.rows.start, device=device)
            latents, centroids = (
                (b[inside] - a[inside]).double().cpu().numpy() for a, b in zip(there, wanted, strict=True)
            )
            yield Residual(archive, view.path(tokens, gap, there[0]), latents, centroids)
