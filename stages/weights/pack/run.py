"""`pumps weights pack`: from the two checkpoints of a run to weights that can be distributed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact
from data_schemas.metrics import read_metrics
from stages.shared.contract import StageReport
from stages.shared.outputs import check_artefact, check_folder, write_output
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.feel_tables import LEGEND, feel_markdown
from stages.shared.statistics.measurements import TRUTH
from stages.shared.statistics.tables import baseline_of, cells, overview, scopes_of
from stages.shared.statistics.tasks import TASK_NAMES
from stages.shared.weights.facts import VERDICT_WORDS, check_of_task, kept_validation, verdicts
from stages.shared.weights.shipped import CARD_NAME, CONFIDENCE_NAME, MEASURED_NAME, parts_of, weights_folder
from stages.shared.weights.task_weights import is_of_task
from stages.weights.pack.config import Config

UNKNOWN = "unknown"  # as `pumps ingest` has it where no licence was stated
_LOGGED = ("step", "split", "loss", "score", "rec_mm", "moving_mm")


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Copy both networks without the optimiser's state, in half precision, and write one card for them.

    The synthesiser's record of its encoder is updated, since the packed encoder is another artefact.

    Raises: InputError if the run has no finished networks, they do not belong together, or other weights were
        measured.
    """
    if is_of_task(config.run):
        return pack_task(config, progress)
    check_folder(config)
    progress.start("packing", 2)
    ae, lms = (open_artefact(path, "checkpoint") for path in parts_of(weights_folder(config.run)))
    autoencoder, synthesiser = _read(ae, config.licence), _read(lms, config.licence)
    if synthesiser.config.get("encoder_digest") != ae.manifest.digest:
        raise InputError(
            f"The synthesiser in {config.run} was trained on another autoencoder than the one beside it.",
            "Train it again with `pumps train lms`.",
        )
    measured, table = _measured(config, ae, lms) if config.measured else ([], "")
    packed = _pack(config, "ae", autoencoder, ae)
    progress.advance()
    synthesiser.config["encoder_digest"] = packed.manifest.digest
    _pack(config, "lms", synthesiser, lms)
    progress.advance()
    name = config.name or config.output.name
    confidence = weights_folder(config.run) / CONFIDENCE_NAME
    if confidence.is_file():
        write_output(config.output / CONFIDENCE_NAME, confidence.read_bytes())
    licences = sorted({*_licences(ae, config.licence), *_licences(lms, config.licence)})
    card = _card(name, autoencoder, synthesiser, licences, measured, table)
    write_output(config.output / MEASURED_NAME, (json.dumps(measured, indent=1) + "\n").encode("utf-8"))
    write_output(config.output / CARD_NAME, card.encode("utf-8"))
    size = sum(path.stat().st_size for path in config.output.rglob("*") if path.is_file())
    return StageReport(
        output=config.output,
        lines=[f"Packed {name}: {size / 1e6:.1f} MB in {config.output}."],
        figures={"bytes": size},
    )


def pack_task(config: Config, progress: Progress) -> StageReport:
    """Copy the network of one task without the optimiser's state, in half precision."""
    check_artefact(config, "checkpoint")
    progress.start("packing", 1)
    source = open_artefact(config.run, "checkpoint")
    kept = _read(source, config.licence)
    check_of_task(kept, config.run)
    measured = kept_validation(kept.log)
    packed = _pack(config, "", replace(kept, log=[measured] if measured else []), source, logged=None)
    progress.advance()
    size = sum(path.stat().st_size for path in packed.folder.iterdir())
    return StageReport(
        output=config.output,
        lines=[f"Packed {config.name or config.output.name}: {size / 1e6:.1f} MB in {config.output}."],
        figures={"bytes": size},
    )


def _read(source: Artefact, known: Sequence[str]) -> Checkpoint:
    """A checkpoint whose card gives only the names of the training's folders, without their paths, and the known
    licences in place of one that was unknown."""
    found = read_checkpoint(source, optimiser=False)
    if known:
        lines = "\n".join(f"  - {licence}" for licence in known)
        found = replace(found, card=found.card.replace(f"  - {UNKNOWN}", lines))
    for place, name in sorted(_places(source.manifest.config), key=lambda each: -len(each[0])):
        found = replace(found, card=found.card.replace(place, name))
    return found


def _pack(
    config: Config, part: str, kept: Checkpoint, source: Artefact, logged: Sequence[str] | None = _LOGGED
) -> Artefact:
    width = np.float16 if config.half else np.float32
    path = config.output / part
    trained = _without_places(source.manifest.config)
    settings = {"half": config.half, "trained": trained, "digest": source.manifest.digest}
    with write_artefact(
        path, "checkpoint", stage="weights-pack", config=settings, licences=_licences(source, config.licence)
    ) as draft:
        write_checkpoint(
            draft.folder,
            weights={name: value.astype(width) for name, value in kept.weights.items()},
            config=kept.config,
            optimiser=None,
            log=[{name: row[name] for name in logged or row if name in row} for row in kept.log],
            card=kept.card,
            trainings=kept.trainings,
        )
    return open_artefact(path, "checkpoint")


def _licences(source: Artefact, known: Sequence[str]) -> list[str]:
    """The licences of the sources; with `known`, those in place of the one that was unknown."""
    stated = set(source.manifest.licences)
    if known and UNKNOWN in stated:
        stated = (stated - {UNKNOWN}) | set(known)
    return sorted(stated)


def _places(settings: Any) -> Iterator[tuple[str, str]]:
    """Every absolute path among settings, and its last part."""
    if isinstance(settings, dict | list):
        for value in settings.values() if isinstance(settings, dict) else settings:
            yield from _places(value)
    elif isinstance(settings, str):
        for kind in (PurePosixPath, PureWindowsPath):
            if kind(settings).is_absolute():
                yield settings, kind(settings).name


def _without_places(settings: Any) -> Any:
    """The settings with each absolute path replaced by its last part."""
    if isinstance(settings, dict):
        return {name: _without_places(value) for name, value in settings.items()}
    if isinstance(settings, list):
        return [_without_places(value) for value in settings]
    return next((name for _, name in _places(settings)), settings)


def _measured(config: Config, ae: Artefact, lms: Artefact) -> tuple[list[dict[str, Any]], str]:
    """Ratios of L2P to the plain baseline, for each archive, task and interval; and, as Markdown, the tables of them
    and, of all archives together, of feel."""
    metrics = open_artefact(str(config.measured), "metrics")
    digests = {source.digest for source in metrics.manifest.inputs}
    if not {ae.manifest.digest, lms.manifest.digest} <= digests:
        raise InputError(
            f"{config.measured} measured other weights than those of {config.run}.",
            "Measure these with `pumps evaluate`.",
        )
    rows, _ = read_metrics(metrics)
    # With the plain interpolation that filling starts from: its difference from the weights is the networks' gain.
    shown = ("damped", config.method)
    every = cells(rows)
    found = {key: cell for key, cell in every.items() if key[3] == "l2p_m" and key[4] in shown}
    if not any(key[4] == config.method for key in found):
        raise InputError(f"{config.measured} has no method {config.method!r}.", "Name it with --method.")
    measured = [
        {
            "scope": scope,
            "task": task,
            "interval": interval,
            "baseline": baseline_of(task),
            "ratio": cell.ratio.value,
            "low": cell.ratio.low,
            "high": cell.ratio.high,
            "windows": cell.windows,
        }
        for (scope, task, interval, _, method), cell in found.items()
        if method == config.method and cell.ratio is not None and np.isfinite(cell.ratio.value)
    ]
    aside = tuple({key[4] for key in every} - {*shown, TRUTH, *map(baseline_of, TASK_NAMES)})
    scope = scopes_of(every)[-1]
    feel = feel_markdown(every, scope, aside=aside)
    return measured, "\n".join([overview(found), feel, *([f"{LEGEND} Of {scope}.\n"] if feel else [])])


def _card(
    name: str,
    autoencoder: Checkpoint,
    synthesiser: Checkpoint,
    licences: list[str],
    measured: list[dict[str, Any]],
    table: str,
) -> str:
    found = verdicts(measured)
    parts = [
        f"# The weights `{name}`",
        "",
        "An autoencoder of temporal point clouds and a latent motion synthesiser, for `pumps infill`.",
        "",
        "The weights carry the licences of the data they were trained on, apart from the code's Apache-2.0:",
        "",
        *[f"- {licence}" for licence in licences or ["none stated"]],
        "",
        f"Gaps longer than {synthesiser.config.get('longest_gap', 0)} frames at 30 fps get a warning; fingers, faces",
        "and props are not theirs: those joints are interpolated plainly.",
        "",
    ]
    if measured:
        parts += [
            "## Good and bad at",
            "",
            "On held-out test clips, mean L2P as a share of that of slerp (in prediction: of a held pose); in",
            "brackets the 95% interval of a bootstrap over clips. `damped` is the plain interpolation that filling",
            "starts from.",
            "",
            *[f"- {words}: {', '.join(found[kind])}." for kind, words in VERDICT_WORDS.items() if found[kind]],
            "",
            table,
        ]
    else:
        parts += ["Nothing was measured of them on test clips yet: `pumps evaluate`.", ""]
    return "\n".join([*parts, autoencoder.card.replace("# ", "## ", 1), synthesiser.card.replace("# ", "## ", 1)])
