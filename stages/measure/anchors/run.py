"""`pumps measure anchors`: what a clip loses when it is reduced to its anchors, beside as many evenly spaced keys."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.measure.anchors.config import Config
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.concepts.segmenting import fit_error_cm, segmented
from stages.shared.contract import StageReport
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.filling import fill_motion
from stages.shared.inference.models import Models, load_weights
from stages.shared.kinematics.forward import positions_of
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.baselines import Poses, slerp
from stages.shared.statistics.bootstrap import mean_interval, ratio_interval
from stages.shared.statistics.measurements import measured_joints
from stages.shared.statistics.metrics import mpjpe_mm
from stages.shared.statistics.table import Entry, Row, Table
from stages.shared.statistics.tables import leaves_out_one, span_text

ANCHORS, EVEN = "anchors", "evenly spaced"
_FIT, _KEYS, _ERROR = "fit_error_cm", "keys_per_s", "mpjpe_mm"
_LONGEST_S = 4.0  # of a transition, as in `pumps segment`


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure and write a `metrics` artefact.

    Raises: UsageError without a lambda; InputError for a bad artefact, or one without a clip of these splits.
    """
    check_artefact(config, "metrics")
    if not config.lambdas or min(config.lambdas) <= 0:
        raise UsageError("--lambdas are prices above 0.", "Give for instance --lambdas 200.")
    models = load_weights(config.weights, config.device) if config.weights else None
    with MotionReader(config.motion) as reader:
        clips = _chosen([row for row in reader.clips if row.split in config.splits], config.max_clips)
        if not clips:
            raise InputError(f"{config.motion} holds no clip of {' or '.join(config.splits)}.", "Give --splits.")
        progress.start("measuring anchors", len(clips))
        rows: list[MetricRow] = []
        for row in clips:
            skeleton = reader.skeleton(row.skeleton)
            motion = reader.motion(row.clip, 0, min(row.frames, max(2, int(config.longest_s * row.fps))))
            rows += _rows(row, skeleton, motion, models, config)
            progress.advance(1, row.clip)
        table = _table(rows, ["slerp", *([models.name] if models else [])], config)
        page = (
            f"# Clips reduced to their anchors\n\nMade by:\n\n```\n{command_line('pumps measure anchors', config)}\n"
            f"```\n\n{len(clips)} clips. Errors of the frames between the keys in mm, mean over clips [95% bootstrap "
            "interval]; the ratio is to as many evenly spaced keys, with a star where its interval leaves out 1. The "
            f"fit is the distance from the splines in cm, on the standard body.\n\n" + "\n".join(table.markdown())
        )
        with write_artefact(
            config.output, "metrics", stage="measure-anchors", config=config, inputs=[reader.artefact]
        ) as draft:
            draft.summary["clips"] = len(clips)
            write_metrics(draft.folder, rows, page + "\n")
    return StageReport(output=config.output, lines=table.markdown(), figures={"clips": len(clips)})


def _chosen(rows: Sequence[ClipRow], most: int) -> list[ClipRow]:
    if not most or len(rows) <= most:
        return list(rows)
    return [rows[at] for at in np.linspace(0, len(rows) - 1, most).astype(int)]


def _rows(
    row: ClipRow, skeleton: Skeleton, motion: Motion, models: Models | None, config: Config
) -> Iterator[MetricRow]:
    body = body_of(skeleton)
    places = body_positions(skeleton, motion, body)
    for price in config.lambdas:
        clip = segmented(places, body.scale, motion.fps, price, _LONGEST_S, degree=config.degree)
        count = len(clip.anchors)
        if count > motion.frames - 1:
            continue
        own = (row.clip, row.skeleton, archive_of(row))
        yield MetricRow(*own, ANCHORS, "segmentation", round(price), _FIT, fit_error_cm(clip))
        yield MetricRow(*own, ANCHORS, "segmentation", round(price), _KEYS, (count - 1) * motion.fps / motion.frames)
        even = np.unique(np.rint(np.linspace(0, motion.frames - 1, count)).astype(int))
        for keys, name in ((clip.anchors, ANCHORS), (even, EVEN)):
            known = np.zeros(motion.frames, bool)
            known[keys] = True
            for filler, error in _errors(skeleton, motion, known, models, config).items():
                yield MetricRow(*own, f"{filler}, {name}", "fill", round(price), _ERROR, error)


def _errors(
    skeleton: Skeleton, motion: Motion, known: np.ndarray, models: Models | None, config: Config
) -> dict[str, float]:
    """Mean distance of the joints over the frames between the keys, mm, of each filler."""
    joints, hidden = measured_joints(skeleton), ~known
    truth = positions_of(skeleton, motion)[hidden][:, joints]
    made = {"slerp": slerp(Poses.of(skeleton, [motion]), known)[0][0]}
    if models is not None:
        source = SynthesisedClouds(models)
        filled = fill_motion(
            skeleton, motion, known, source, seed=config.seed, device=models.autoencoder.device
        ).motion
        made[models.name] = positions_of(skeleton, filled)
    return {
        name: float(mpjpe_mm(np.asarray(found)[hidden][None, :, joints], truth[None])[0])
        for name, found in made.items()
    }


def _table(rows: Sequence[MetricRow], fillers: Sequence[str], config: Config) -> Table:
    out = []
    for price in dict.fromkeys(round(each) for each in config.lambdas):
        mine = [row for row in rows if row.interval == price]
        entries = [Entry(f"{_of(mine, ANCHORS, metric).mean():.2f}") for metric in (_KEYS, _FIT)]
        for filler in fillers:
            anchors, even = (_of(mine, f"{filler}, {name}", _ERROR) for name in (ANCHORS, EVEN))
            ones = np.ones(len(anchors))
            ratio = ratio_interval(anchors, ones, even, ones, config.seed)
            star = "*" if leaves_out_one(ratio) else ""
            for values, shown in ((anchors, f"×{ratio.value:.2f}{star}"), (even, "")):
                mean = mean_interval(values, ones, config.seed)
                entries.append(Entry(f"{mean.value:.1f}", span_text(mean, 1), shown))
        out.append(Row((str(price),), tuple(entries)))
    heads = [f"{filler}, {name}" for filler in fillers for name in (ANCHORS, EVEN)]
    return Table(("lambda",), ("keys a second", "fit, cm", *heads), tuple(out))


def _of(rows: Sequence[MetricRow], method: str, metric: str) -> np.ndarray:
    return np.array([row.value for row in rows if row.method == method and row.metric == metric])
