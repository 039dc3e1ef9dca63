"""`pumps weights calibrate`: fit the confidence of weights on clips that they were not trained on."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
import torch

from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.contract import StageReport
from stages.shared.inference.cloud_interfaces import Scene
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.confidence import SHAPE, Confidence, write_confidence
from stages.shared.inference.filling import FillOptions, believed_shares, find_clouds, solve_clouds, start_from
from stages.shared.inference.models import Models, load_weights
from stages.shared.inference.token_times import Tokens
from stages.shared.inference.trust_fit import Sums, gain, trust_fit
from stages.shared.inference.trust_gaps import add_gaps
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.resampling import resample
from stages.shared.outputs import check_written
from stages.shared.progress import SILENT, Progress
from stages.shared.solve.solving import Corrections
from stages.shared.statistics.windows import planned_windows, tasks_of
from stages.shared.weights.shipped import CONFIDENCE_NAME, weights_folder
from stages.weights.calibrate.config import Config


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Fit the trust and write it beside the weights.

    Raises: InputError for bad weights or motions, or if no clip of the splits is long enough.
    """
    check_written(config, weights_folder(config.weights) / CONFIDENCE_NAME, "weights")
    models = load_weights(config.weights, config.device, confidence=False)
    archives: dict[str, Sums] = {}
    shrunk: dict[str, Sums] = {}
    with ExitStack() as opened:
        readers = [opened.enter_context(MotionReader(path)) for path in config.motion]
        tasks = tasks_of(config.intervals, config.transitions, config.predictions, config.window)
        plan = [
            (reader, *each)
            for reader in readers
            for each in planned_windows(reader.clips, config.splits, tasks, config.max_windows)
        ]
        if not plan:
            raise InputError(
                f"{', '.join(map(str, config.motion))} has no clip of the split {' or '.join(config.splits)} that is "
                "long enough.",
                "Name another with --splits.",
            )
        progress.start("filling", len(plan))
        for reader, archive, task, window in plan:
            row = reader.row(window.clip)
            motion = resample(reader.motion(row.clip), MODEL_FPS).at(window.span)
            scene, made = _solved(config, models, reader.skeleton(row.skeleton), motion, task.known(window.frames))
            whole, floored = (each.setdefault(archive, Sums()) for each in (archives, shrunk))
            add_gaps(scene, made, motion, (whole, made), (floored, _with_floors(made, scene.tokens)))
            progress.advance(1, row.clip)
    trust = trust_fit(archives, config.prior_windows)
    gains = {name: _gains(archives, shrunk, name, config) for name in archives}
    path = weights_folder(config.weights) / CONFIDENCE_NAME
    write_confidence(path, Confidence(trust), {"windows": len(plan), "gains": gains})
    return _report(config, models, trust, gains, len(plan))


def _solved(
    config: Config, models: Models, skeleton: Skeleton, motion: Motion, known: np.ndarray
) -> tuple[Scene, Corrections]:
    """The corrections that filling finds, before they are multiplied by the confidence."""
    source, options = SynthesisedClouds(models), FillOptions()
    start = start_from(skeleton, motion, known, source, device=models.autoencoder.device, options=options)
    with torch.no_grad():
        clouds = find_clouds(start, source, points=config.points, seed=config.seed, options=options)
        return start.scene, solve_clouds(start, clouds, options.solve)


def _with_floors(made: Corrections, tokens: Tokens) -> Corrections:
    """Corrections as used without a confidence."""
    turns, shifts = made.turns.clone(), made.shifts.clone()
    for gap in tokens.gaps():
        turn_shares, shift_share = believed_shares(made, gap, FillOptions())
        turns[gap] *= turn_shares.unsqueeze(-1)
        shifts[gap] *= shift_share
    return made._replace(turns=turns, shifts=shifts)


def _gains(archives: dict[str, Sums], shrunk: dict[str, Sums], name: str, config: Config) -> dict[str, float]:
    """For an archive: the share that its corrections achieve with trust fitted on the others, unscaled, and shrunk by
    the fixed floors."""
    others = {other: sums for other, sums in archives.items() if other != name} or archives
    everything = np.ones(SHAPE)
    return {
        "trusted": gain(archives[name], trust_fit(others, config.prior_windows)),
        "as they are": gain(archives[name], everything),
        "fixed floors": gain(shrunk[name], everything),
    }


def _report(
    config: Config, models: Models, trust: np.ndarray, gains: dict[str, dict[str, float]], windows: int
) -> StageReport:
    lines = [
        f"Trust of {models.name} from {windows} windows of {len(gains)} archives, kept in "
        f"{weights_folder(config.weights) / CONFIDENCE_NAME}; mean {trust.mean():.2f}.",
        "Share of what corrections should have done to places (squares) that they are right about; trust learned on "
        "the other archives:",
    ]
    for name, each in gains.items():
        lines.append(f"  {name}: " + ", ".join(f"{how} {value:.3f}" for how, value in each.items()))
    return StageReport(lines=lines, figures={"windows": windows, "gains": gains, "trust": trust.tolist()})
