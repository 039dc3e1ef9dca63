"""`pumps measure denoise`: methods that clean the same noisy windows, measured by category."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.checkpoint import read_checkpoint
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.tpc import TpcReader
from stages.measure.denoise.config import Config
from stages.measure.denoise.methods import (
    MEND,
    NOISY,
    TRUE_CLOUDS,
    TRUE_LATENTS,
    Cleaner,
    NoisyWindows,
    best_widths,
    filter_cleaner,
    latent_cleaner,
    network_cleaner,
    oracle_cleaner,
    prior_cleaner,
)
from stages.measure.denoise.summary import METRICS, summary_md, terminal_lines
from stages.shared.contract import StageReport
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.inference.held_out_tasks import clean_windows, window_random
from stages.shared.inference.kept_models import kept_models
from stages.shared.inference.latent_denoiser import LatentDenoiser, load_denoiser
from stages.shared.inference.pose_filling import Interpolator, is_interpolator, load_interpolator
from stages.shared.inference.pose_model import PoseModel, load_pose_model
from stages.shared.kinematics.motion_filters import FILTERS
from stages.shared.outputs import check_artefact
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.denoise import DenoiseTask
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.metrics import acceleration_mm, mpjae_deg, mpjpe_mm
from stages.shared.statistics.rig_windows import windows_by_category
from stages.shared.statistics.tasks import DENOISING
from stages.shared.training.pose_training import sets_of_rig
from stages.shared.weights.shipped import named_source

_NO_NOISE = "none"


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure every method on the same noisy windows; write `metrics`.

    Raises: UsageError for an unknown filter, two rows of one name or no rig; InputError for networks of another rig,
        or where no held-out clip of the rig is long enough.
    """
    check_artefact(config, "metrics")
    for name in config.filters:
        if name not in FILTERS:
            raise UsageError(f"There is no filter {name!r}.", f"Take of {', '.join(FILTERS)}.")
    models, denoisers, priors = _loaded(config)
    rig = _rig(config, models)
    with TpcReader(config.tpc) as reader:
        own = sets_of_rig(reader, rig)
        measured = (config.category, config.window, config.max_windows, config.tpc)
        windows = [*windows_by_category(reader.clips, own, config.splits, *measured)]
        widths = _tuned(reader, rig, own, config)
        methods = {**_methods(rig, models, denoisers, priors, widths), **_oracles(rig, config)}
        progress.start("cleaning", sum(len(starts) for *_, starts in windows) * len(methods))
        rows = []
        for category, clip, starts in windows:
            clean = clean_windows(reader, clip, starts, config.window)
            seen = NoisyWindows.of(rig, _noisy(rig, clean, clip, starts, config), clean)
            for name, cleaner in methods.items():
                figures = _figures(rig, cleaner(seen), clean)
                place = (clip.clip, clip.skeleton, category, name, DENOISING, config.window)
                for metric, value in zip(METRICS, figures, strict=True):
                    rows.append(MetricRow(*place, metric, value, windows=len(starts)))
                progress.advance(len(starts), f"{category}, {name}")
        inputs = [reader.artefact, *(open_artefact(_source(text), "checkpoint") for text in config.weights)]
    with write_artefact(config.output, "metrics", stage="measure-denoise", config=config, inputs=inputs) as draft:
        count = sum(len(starts) for *_, starts in windows)
        draft.summary.update(windows=count, methods=[*methods], widths=dict(widths))
        trained = {**models, **denoisers, **priors}
        write_metrics(draft.folder, rows, summary_md(config, rows, trained, widths))
    return StageReport(
        output=config.output,
        lines=[
            *_notes(rig, config),
            *terminal_lines(rows, config.seed),
            f"Full tables: {config.output}, summary.md.",
        ],
        figures={"windows": count, "methods": [*methods], "widths": dict(widths)},
    )


def _source(text: str) -> Path:
    return Path(named_source(text)[1])


def _loaded(
    config: Config,
) -> tuple[dict[str, PoseModel], dict[str, LatentDenoiser], dict[str, Interpolator]]:
    """Fine-tuned networks, denoisers of latents and priors, by name."""
    models: dict[str, PoseModel] = {}
    denoisers: dict[str, LatentDenoiser] = {}
    priors: dict[str, Interpolator] = {}
    for text in config.weights:
        name, source = named_source(text)
        if name in {NOISY, MEND, TRUE_LATENTS, TRUE_CLOUDS, *config.filters, *models, *denoisers, *priors}:
            raise UsageError(f"Two rows are called {name!r}.", f"Give another name: --weights NAME={source}.")
        kept = read_checkpoint(open_artefact(source, "checkpoint"), optimiser=False)
        if kept.config.get("network") == "denoiser":
            denoisers[name] = load_denoiser(source, kept_models(config.fill, config.device).autoencoder)
            continue
        if not is_interpolator(kept.config):
            models[name] = load_pose_model(source, ("denoise", "repair"), config.device)
            continue
        priors[name] = load_interpolator(source, config.device)
        if not priors[name].denoises:
            raise InputError(
                f"{source} holds a network that fills gaps and cannot clean noisy motion.",
                "Train one with --method motion-vae or pose-ndf.",
            )
    return models, denoisers, priors


def _oracles(rig: Rig, config: Config) -> dict[str, Cleaner]:
    """With `breakdown`, what cleans windows by knowing the truth."""
    if not config.breakdown:
        return {}
    models = kept_models(config.fill, config.device)
    return {kind: oracle_cleaner(rig, models, kind) for kind in (TRUE_LATENTS, TRUE_CLOUDS)}


def _rig(config: Config, models: dict[str, PoseModel]) -> Rig:
    """The rig that is measured. Raises UsageError if nothing names it, InputError for networks of several rigs."""
    if not models and config.skeleton is None:
        raise UsageError("Nothing says which rig is measured.", "Give --skeleton rig.bvh.")
    rigs = {name: model.rig for name, model in models.items()}
    if config.skeleton is not None:
        rigs = {config.skeleton: rig_of_file(config.skeleton), **rigs}
    (first, rig), *others = rigs.items()
    for name, other in others:
        if not other.is_like(rig):
            raise InputError(f"{first} and {name} are of different rigs.", "Measure them one by one.")
    return rig


def _methods(
    rig: Rig,
    models: dict[str, PoseModel],
    denoisers: dict[str, LatentDenoiser],
    priors: dict[str, Interpolator],
    widths: dict[str, float],
) -> dict[str, Cleaner]:
    for name, prior in priors.items():
        prior.check_hierarchy(rig.body.parents, rig.body.groups.numpy(), f"the rig that {name} is measured on")
    return {
        NOISY: lambda seen: seen.noisy,
        **{name: filter_cleaner(rig, FILTERS[name], width) for name, width in widths.items()},
        MEND: lambda seen: seen.mended,
        **{name: prior_cleaner(rig, prior) for name, prior in priors.items()},
        **{name: latent_cleaner(rig, denoiser) for name, denoiser in denoisers.items()},
        **{name: network_cleaner(model) for name, model in models.items()},
    }


def _tuned(reader: TpcReader, rig: Rig, own: frozenset[str], config: Config) -> dict[str, float]:
    """The width of each filter: of several the best on windows of another split, which see the same noise."""
    if len(config.widths) == 1 or not config.filters:
        return {name: config.widths[0] for name in config.filters}
    chosen = (("all=*",), config.window, config.tune_windows, config.tpc)
    found = [*windows_by_category(reader.clips, own, (config.tune_on,), *chosen)]
    clean = [clean_windows(reader, clip, starts, config.window) for _, clip, starts in found]
    # Without noise, the widths are those that are best for the paper's noise.
    noise = config if config.noise != _NO_NOISE else config.model_copy(update={"noise": "paper"})
    noisy = [_noisy(rig, each, clip, starts, noise) for each, (_, clip, starts) in zip(clean, found, strict=True)]
    return dict(best_widths(rig, config.filters, config.widths, BodyPose.joined(noisy), BodyPose.joined(clean)))


def _noisy(rig: Rig, clean: BodyPose, clip: ClipRow, starts: list[int], config: Config) -> BodyPose:
    """The windows with noise, which depends on the seed, the clip and the start alone."""
    if config.noise == _NO_NOISE:
        return clean
    return DenoiseTask(rig, config.noise).corrupted(
        clean, [window_random(config.seed, clip, start) for start in starts]
    )


def _notes(rig: Rig, config: Config) -> list[str]:
    if config.noise == _NO_NOISE:
        return []
    return [f"Note: {note}" for note in DenoiseTask(rig, config.noise).notes]


def _figures(rig: Rig, made: BodyPose, truth: BodyPose) -> list[float]:
    """The means over windows of `METRICS`."""
    heads = [pose.heads(rig.body).double().numpy() for pose in (made, truth)]
    turns = [pose.rotations.double().numpy() for pose in (made, truth)]
    found = (mpjpe_mm(*heads), acceleration_mm(*heads), mpjae_deg(*turns))
    return [float(np.mean(each)) for each in found]
