"""`pumps measure body-parts`: autoencoders of body parts on seen and unseen data, with and without noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.artefact import write_artefact
from data_schemas.manifest import Artefact, open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader
from data_schemas.skeleton import BODY_GROUPS
from stages.measure.body_parts.config import Config
from stages.measure.body_parts.lost import rows_of_lost, stretches_of
from stages.measure.body_parts.noise import tampered_slices, with_input_noise, with_tampering, with_zeros
from stages.measure.body_parts.picture import locality_picture
from stages.measure.body_parts.summary import (
    INPUT,
    LATENT,
    METRICS,
    SCENARIOS,
    Measured,
    harms_of,
    summary_md,
    tamper_task,
    terminal_lines,
)
from stages.shared.contract import StageReport
from stages.shared.humanoid.clips_on_rig import RotationClip, clips_on_rig
from stages.shared.inference.models import load_weights
from stages.shared.inference.part_models import PartBody, load_part_bodies, refuse_repeats
from stages.shared.kinematics.matrix_poses import columns_of
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.part_errors import grouped, joint_errors
from stages.shared.statistics.window_seeds import seed_words
from stages.shared.weights.shipped import named_source, parts_of, weights_folder

_PICTURE = "locality.svg"
_TAMPER_WINDOWS = 64


@dataclass(frozen=True)
class _Clip:
    """local (N, T, B, 4): all windows of a clip that are measured."""

    name: str
    skeleton: str
    local: Tensor


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure every body on the same windows; write `metrics`, with a picture of the locality.

    Raises: UsageError for two bodies or data sets of one name; InputError for bodies of different rigs, windows or
        rates, or where a data set has no clip as long as a window.
    """
    check_artefact(config, "metrics")
    seen_set = (*named_source(config.motion, "--motion"), True)
    sets = [seen_set, *((*named_source(text, "--unseen"), False) for text in config.unseen)]
    refuse_repeats([name for name, *_ in sets], "--motion and --unseen")
    bodies = load_part_bodies(config.weights, config.device, config.blend)
    first = next(iter(bodies.values()))
    inputs: list[Artefact] = [each for body in bodies.values() for each in body.inputs]
    models = load_weights(config.pumps, config.device) if config.pumps is not None else None
    if config.pumps is not None:
        inputs += [open_artefact(part, "checkpoint") for part in parts_of(weights_folder(config.pumps))]
    rows: list[MetricRow] = []
    notes: list[str] = []
    harms: dict[str, np.ndarray] = {}
    for label, folder, seen in sets:
        with MotionReader(folder) as reader:
            inputs.append(reader.artefact)
            splits = config.splits if seen else config.unseen_splits
            wanted = [row for row in reader.clips if row.split in splits]
            progress.start(f"reading {label}")
            clips, told = clips_on_rig(reader, wanted, first.body, first.rate_hz, first.window, config.clip_seconds)
            notes += [f"{label}: {sentence}" for sentence in told]
            stretches = stretches_of(reader, wanted, first, config) if models is not None else []
        windows = _windows(clips, first.window, config.max_windows)
        if models is not None:
            if not stretches:
                notes.append(f"{label}: No clip is long enough for limbs that are lost; lost_seconds is too high.")
            progress.start(f"completing limbs of {label}", len(stretches))
            rows += rows_of_lost(config, label, bodies, models, stretches, progress)
        progress.start(f"measuring {label}", len(SCENARIOS) * len(bodies))
        for name, body in bodies.items():
            rows += _rows_of_set(config, label, name, body, windows, progress)
            if seen and config.tampered:
                harmed = _tampered(config, label, name, body, windows)
                rows += harmed
                harms[name] = harms_of(harmed, name, _pieces(body))
    measured = Measured(
        {name: (_column(body), body.kinds, body.parameters) for name, body in bodies.items()},
        [label for label, *_ in sets],
        {name: _pieces(body) for name, body in bodies.items()},
    )
    with write_artefact(
        config.output, "metrics", stage="measure-body-parts", config=config, inputs=_different(inputs)
    ) as draft:
        draft.summary.update(notes=notes, parameters={name: body.parameters for name, body in bodies.items()})
        write_metrics(draft.folder, rows, summary_md(config, rows, measured, notes))
        if harms:
            (draft.folder / _PICTURE).write_text(locality_picture(harms, measured.pieces), encoding="utf-8")
    return StageReport(
        output=config.output,
        lines=[*notes, *terminal_lines(rows, measured)],
        figures={"rows": len(rows), "bodies": list(bodies)},
    )


def _column(body: PartBody) -> str:
    return f"BPs{len(body.parts)}"


def _pieces(body: PartBody) -> tuple[str, ...]:
    """Names of what is tampered with: the parts, or fifths of the latent of a whole body."""
    if len(body.parts) > 1:
        return tuple(each.part.name for each in body.parts)
    return tuple(f"fifth {number}" for number in range(1, len(BODY_GROUPS) + 1))


def _different(inputs: Sequence[Artefact]) -> list[Artefact]:
    return list({each.manifest.digest: each for each in inputs}.values())


def _windows(clips: Sequence[RotationClip], window: int, most: int) -> list[_Clip]:
    """Windows that do not overlap; of too many, evenly spread ones over all clips."""
    places = [
        (index, start) for index, clip in enumerate(clips) for start in range(0, len(clip.local) - window + 1, window)
    ]
    if most and len(places) > most:
        places = [places[int(i)] for i in np.unique(np.linspace(0, len(places) - 1, most).round().astype(int))]
    found: dict[int, list[np.ndarray]] = {}
    for index, start in places:
        found.setdefault(index, []).append(clips[index].local[start : start + window])
    return [
        _Clip(clips[index].row.clip, clips[index].row.skeleton, torch.from_numpy(np.stack(windows)))
        for index, windows in found.items()
    ]


def _rows_of_set(
    config: Config, label: str, name: str, body: PartBody, clips: Sequence[_Clip], progress: Progress
) -> Iterator[MetricRow]:
    """For each clip, scenario and metric: the mean over the seeds, and the deviation over them."""
    drawn = any(each.kind in ("vae", "svae") for each in body.parts)
    local = torch.cat([clip.local for clip in clips])
    truth = columns_of(local)
    bounds = np.cumsum([0, *(len(clip.local) for clip in clips)])
    for scenario, noises in SCENARIOS.items():
        values = []
        for seed in range(config.seeds if noises or drawn else 1):
            generator = _generator(config.seed, label, seed)
            given = with_input_noise(local, config.noise_deg, generator) if INPUT in noises else local
            columns = columns_of(given).to(body.device)
            latents = body.encode(columns, _on(body.device, generator) if drawn else None)
            if LATENT in noises:
                latents = with_zeros(latents, config.zeroed, generator)
            errors = joint_errors(body.decode(latents).cpu(), truth, body.body.offsets, body.body.parents)
            values.append([each.mean((1, 2)) for each in (errors.distance_cm, errors.global_deg)])
        progress.advance(1, f"{name}, {scenario}")
        for metric, windows in zip(METRICS, np.array(values).swapaxes(0, 1), strict=True):  # (seeds, windows)
            for clip, start, stop in zip(clips, bounds[:-1], bounds[1:], strict=True):
                common = (clip.name, clip.skeleton, label, name, scenario, body.window)
                own = windows[:, start:stop].mean(1)
                yield MetricRow(*common, metric, float(own.mean()), windows=len(clip.local))
                yield MetricRow(*common, f"{metric}_over_seeds", float(own.std()), windows=len(clip.local))


def _tampered(config: Config, label: str, name: str, body: PartBody, clips: Sequence[_Clip]) -> list[MetricRow]:
    """How far each body group moves when each part's latent is tampered with, from what it is without."""
    local = torch.cat([clip.local for clip in clips])[:_TAMPER_WINDOWS]
    columns = columns_of(local).to(body.device)
    latents = body.encode(columns)
    before = body.decode(latents).cpu()
    rows = []
    groups = body.body.groups
    for piece, (index, part) in zip(_pieces(body), tampered_slices(body.widths, len(BODY_GROUPS)), strict=True):
        found = []
        for seed in range(config.seeds):
            generator = _generator(config.seed, piece, seed)
            changed = with_tampering(latents, index, part, config.tampered, generator)
            errors = joint_errors(body.decode(changed).cpu(), before, body.body.offsets, body.body.parents)
            kinds = (errors.distance_cm, errors.local_deg)
            found.append([grouped(each, groups, len(BODY_GROUPS)) for each in kinds])
        for metric, means in zip(("cm", "local_deg"), np.mean(found, axis=0), strict=True):
            for group, value in zip(BODY_GROUPS, means, strict=True):
                rows.append(
                    MetricRow(
                        "all", "", label, name, tamper_task(piece), body.window, f"{group}_{metric}", float(value),
                        windows=len(local),
                    )
                )  # fmt: skip
    return rows


def _on(device: torch.device, generator: torch.Generator) -> torch.Generator:
    """A generator on the device, seeded by the next draw of another."""
    seed = int(torch.randint(2**62, (), generator=generator))
    return torch.Generator(device).manual_seed(seed)


def _generator(seed: int, name: str, number: int) -> torch.Generator:
    words = seed_words(seed, name, number)
    return torch.Generator().manual_seed(int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0] >> 1))
