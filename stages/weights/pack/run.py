"""`pumps weights pack`: from the two checkpoints of a run to weights that can be distributed."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np

from data_schemas.artefact import open_artefact
from data_schemas.checkpoint import Checkpoint
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
from stages.shared.weights.packing import LOGGED, licences_of, read_to_pack, write_packed
from stages.shared.weights.shipped import CARD_NAME, CONFIDENCE_NAME, MEASURED_NAME, parts_of, weights_folder
from stages.shared.weights.task_weights import is_of_task
from stages.weights.pack.config import Config


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
    autoencoder, synthesiser = read_to_pack(ae, config.licence), read_to_pack(lms, config.licence)
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
    licences = sorted({*licences_of(ae, config.licence), *licences_of(lms, config.licence)})
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
    kept = read_to_pack(source, config.licence)
    check_of_task(kept, config.run)
    measured = kept_validation(kept.log)
    packed = _pack(config, "", replace(kept, log=[measured] if measured else []), source)
    progress.advance()
    size = sum(path.stat().st_size for path in packed.folder.iterdir())
    return StageReport(
        output=config.output,
        lines=[f"Packed {config.name or config.output.name}: {size / 1e6:.1f} MB in {config.output}."],
        figures={"bytes": size},
    )


def _pack(config: Config, part: str, kept: Checkpoint, source: Artefact) -> Artefact:
    return write_packed(
        config.output / part,
        kept,
        source,
        stage="weights-pack",
        licences=licences_of(source, config.licence),
        half=config.half,
        logged=LOGGED if part else None,
    )


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
