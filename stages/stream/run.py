"""`pumps stream`: clips sent in packets over a channel that loses some, by parts' latents and by rotations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from data_schemas.artefact import write_artefact
from data_schemas.errors import UsageError
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader
from data_schemas.skeleton import BODY_GROUPS
from stages.shared.contract import StageReport
from stages.shared.humanoid.clips_on_rig import RotationClip, clips_on_rig
from stages.shared.inference.part_models import PartBody, load_part_bodies
from stages.shared.kinematics.matrix_poses import columns_of
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.part_errors import joint_errors
from stages.shared.statistics.window_seeds import seed_words
from stages.stream.channel import arrived
from stages.stream.config import Config
from stages.stream.picture import loss_picture
from stages.stream.summary import ANGLE, BYTES, ERROR, SEEN, UNSEEN, advice, curves, loss_task, summary_md
from stages.stream.ways import (
    LatentRange,
    bytes_of_parts,
    bytes_of_rotations,
    range_of,
    streamed_parts,
    streamed_rotations,
)

_PICTURE = "streaming.svg"
_RANGE_WINDOWS = 256


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Stream every clip in every way; write `metrics` with a picture.

    Raises: UsageError for a loss that the channel cannot have, an unknown body group, or a name twice; InputError for
        bodies of different rigs or windows, or where no clip is as long as a window.
    """
    check_artefact(config, "metrics")
    hidden = _checked(config)
    bodies = load_part_bodies(config.weights, config.device)
    first = next(iter(bodies.values()))
    with MotionReader(config.motion) as reader:
        progress.start("reading clips")
        chosen = [row for row in reader.clips if row.split in config.splits]
        if config.max_clips and len(chosen) > config.max_clips:
            places = np.unique(np.linspace(0, len(chosen) - 1, config.max_clips).round().astype(int))
            chosen = [chosen[int(place)] for place in places]
        settings = (first.body, first.rate_hz, first.window, config.clip_seconds)
        clips, notes = clips_on_rig(reader, chosen, *settings)
        training = [row for row in reader.clips if row.split == "train"][: _RANGE_WINDOWS // 4]
        known = _windows(clips_on_rig(reader, training, *settings)[0] if training else clips, first.window)
        inputs = [reader.artefact, *(each for body in bodies.values() for each in body.inputs)]
    some = known[torch.from_numpy(np.unique(np.linspace(0, len(known) - 1, _RANGE_WINDOWS).astype(int)))]
    ranges = {name: range_of(body, some) for name, body in bodies.items()}
    sizes = _sizes(config, bodies)
    rows: list[MetricRow] = []
    progress.start("streaming", len(clips) * len(config.loss))
    for clip in clips:
        columns = _windows([clip], first.window)
        for loss in sorted(config.loss):
            rows += _streamed(config, bodies, ranges, clip, columns, loss)
            progress.advance(1, clip.row.clip)
        for name, body in bodies.items():
            rows += _with_absent(body, name, clip, columns, hidden)
    rows += [MetricRow("all", "", "", name, "all", config.bits, BYTES, size) for name, size in sizes.items()]
    lines = curves(rows, list(sizes), sorted(config.loss))
    with write_artefact(
        config.output, "metrics", stage="stream", config=config,
        inputs=list({each.manifest.digest: each for each in inputs}.values()),
    ) as draft:  # fmt: skip
        draft.summary.update(notes=notes, bytes_per_second=sizes)
        write_metrics(draft.folder, rows, summary_md(config, rows, sizes, list(bodies), notes))
        words = {name: f", {size:.0f} bytes a second" for name, size in sizes.items()}
        picture = loss_picture(lines, sorted(config.loss), words)
        (draft.folder / _PICTURE).write_text(picture, encoding="utf-8")
    told = [
        f"{name:20} {sizes[name]:7.0f} bytes a second, MPJPE {values[0]:.2f} to {values[-1]:.2f} cm"
        for name, values in lines.items()
    ]
    return StageReport(
        output=config.output,
        lines=[*notes, *told, advice(lines, sizes, sorted(config.loss))],
        figures={"bytes_per_second": sizes, "mpjpe_180_cm": lines},
    )


def _checked(config: Config) -> list[int]:
    """The numbers of the absent groups. Raises UsageError for losses or groups that do not exist."""
    for loss in config.loss:
        if not 0 <= loss < 1 or loss / (1 - loss) > config.burst:
            raise UsageError(
                f"A loss of {loss:g} cannot be in runs of {config.burst:g}.", "Raise burst or lower loss."
            )
    if any(each < 1 for each in config.every):
        raise UsageError("--every must be 1 or more.")
    for group in config.absent:
        if group not in BODY_GROUPS:
            raise UsageError(f"There is no body group {group!r}.", f"Take of {', '.join(BODY_GROUPS)}.")
    return [BODY_GROUPS.index(group) for group in config.absent]


def _rotations_name(every: int) -> str:
    return "rotations" if every == 1 else f"rotations, every {every} frames"


def _sizes(config: Config, bodies: dict[str, PartBody]) -> dict[str, float]:
    """Bytes a second of every way."""
    first = next(iter(bodies.values()))
    seconds = first.window / first.rate_hz
    sizes = {n: bytes_of_parts(b.widths, config.bits, config.header_bytes, seconds) for n, b in bodies.items()}
    for every in config.every:
        joints = len(first.body.joints)
        sizes[_rotations_name(every)] = bytes_of_rotations(joints, every, first.rate_hz, config.header_bytes)
    return {name: float(size) for name, size in sizes.items()}


def _windows(clips: Sequence[RotationClip], window: int) -> Tensor:
    """(N, T, B, 6) columns of windows that follow one another."""
    parts = [
        each.local[: len(each.local) // window * window].reshape(-1, window, *each.local.shape[1:]) for each in clips
    ]
    return columns_of(torch.from_numpy(np.concatenate(parts)))


def _streamed(
    config: Config,
    bodies: dict[str, PartBody],
    ranges: dict[str, LatentRange],
    clip: RotationClip,
    columns: Tensor,
    loss: float,
) -> Iterator[MetricRow]:
    first = next(iter(bodies.values()))
    frames = len(columns) * first.window
    local = clip.local[:frames]
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in range(config.seeds if loss else 1):

        def channel(count: int, seed: int = seed) -> np.ndarray:
            own = np.random.default_rng(seed_words(config.seed, clip.row.clip, seed))
            return arrived(count, loss, config.burst, own)

        for name, body in bodies.items():
            made, _ = streamed_parts(body, columns, ranges[name], config.bits, channel)
            found.setdefault(name, []).append(_errors(body, made, columns))
        for every in config.every:
            turned, _ = streamed_rotations(local, every, channel)
            shape = (len(columns), first.window, *local.shape[1:])
            held = columns_of(torch.from_numpy(turned).reshape(shape))
            found.setdefault(_rotations_name(every), []).append(_errors(first, held, columns))
    for name, values in found.items():
        for metric, value in zip((ERROR, ANGLE), np.mean(values, axis=0), strict=True):
            yield _row(clip, name, loss_task(loss), first.window, metric, float(value), len(columns))


def _with_absent(
    body: PartBody, name: str, clip: RotationClip, columns: Tensor, hidden: Sequence[int]
) -> Iterator[MetricRow]:
    """Errors of the groups that are seen, where all are seen and where some are not."""
    seen = ~np.isin(body.body.groups, hidden)
    for task, given in ((SEEN, columns), (UNSEEN, body.without_groups(columns, hidden))):
        made = body.decode(body.encode(given.to(body.device))).cpu()
        errors = joint_errors(made, columns, body.body.offsets, body.body.parents)
        yield _row(clip, name, task, body.window, ERROR, float(errors.distance_cm[..., seen].mean()), len(columns))


def _errors(body: PartBody, made: Tensor, truth: Tensor) -> tuple[float, float]:
    errors = joint_errors(made, truth, body.body.offsets, body.body.parents)
    return float(errors.distance_cm.mean()), float(errors.global_deg.mean())


def _row(clip: RotationClip, name: str, task: str, window: int, metric: str, value: float, windows: int) -> MetricRow:
    archive = clip.row.archive or ""
    return MetricRow(clip.row.clip, clip.row.skeleton, archive, name, task, window, metric, value, windows=windows)
