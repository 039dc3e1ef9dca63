"""`pumps measure concepts`: generated and refined motions, in the shape of the tables of motion concepts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.concepts import ConceptsReader
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact
from data_schemas.metrics import MetricRow, write_metrics
from stages.measure.concepts.config import Config
from stages.measure.concepts.motions import Features, features_of_made, features_of_real
from stages.shared.concepts.segmenting import fit_error_cm
from stages.shared.concepts.sequences import ConceptSet, concept_set
from stages.shared.contract import StageReport
from stages.shared.inference.recognising import RecogniserModel, load_recogniser
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.categories import named
from stages.shared.statistics.generation import (
    ACTION_SAMPLES,
    DIVERSITY_PAIRS,
    FID_SAMPLES,
    MULTIMODALITY_PAIRS,
    Repeated,
    measures_of,
    repeated,
)
from stages.shared.statistics.table import Entry, Row, Table

REAL, OTHERS = "real", "real, other splits"
_HEADS = {
    "a_fid": "A-FID", "fid": "FID", "accuracy": "accuracy, %", "diversity": "diversity",
    "multimodality": "multimodality",
}  # fmt: skip
_DISTANCES = ("a_fid", "fid")
Measured = Mapping[str, Repeated]


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure and write a `metrics` artefact.

    Raises: UsageError for two rows of one name; InputError for motions of another rig, rate or action than the
        recogniser's, or no real motion of these splits.
    """
    check_artefact(config, "metrics")
    made = named("made", config.made, (REAL, OTHERS))
    fits = named("fits", config.fits)
    model = load_recogniser(config.recogniser, config.device)
    progress.start("measuring", 2 + len(made) + len(fits))
    with ConceptsReader(config.concepts) as reader:
        found = concept_set(reader, model.actions)
        inputs: list[Artefact] = [model.artefact, reader.artefact]
    _check(model, found, config)
    real = features_of_real(model, found, config.splits)
    if real is None:
        raise InputError(f"{config.concepts} holds no real motion of {', '.join(config.splits)}.", "Give --splits.")
    groups: dict[str, Features] = {REAL: real}
    progress.advance(note=REAL)
    others = features_of_real(model, found, sorted({"train", "val", "test"} - set(config.splits)))
    if others is not None:
        groups[OTHERS] = others
    progress.advance(note=OTHERS)
    for name, folder in made.items():
        groups[name], artefact = features_of_made(model, Path(folder), config.actions)
        inputs.append(artefact)
        progress.advance(note=name)
    measured = {}
    for name, each in groups.items():
        against = None if name == REAL else (real.features, real.actions)
        measures = measures_of(each.features, each.logits, each.actions, against)
        measured[name] = repeated(measures, config.seed, config.repetitions)
    fit_of = {}
    for name, folder in fits.items():
        with ConceptsReader(Path(folder)) as reader:
            fit_of[name] = _fit_cm(reader, config)
            inputs.append(reader.artefact)
        progress.advance(note=name)
    table = _table(measured, {name: len(each.actions) for name, each in groups.items()}, fit_of)
    page = _page(table, model, groups, found, config)
    with write_artefact(config.output, "metrics", stage="measure-concepts", config=config, inputs=inputs) as draft:
        write_metrics(draft.folder, list(_rows(measured, groups, fit_of, found)), page)
    figures = {name: {key: vars(value) for key, value in each.items()} for name, each in measured.items()}
    return StageReport(
        output=config.output, lines=table.markdown(), figures={"measured": figures, "fit_error_cm": fit_of}
    )


def _check(model: RecogniserModel, found: ConceptSet, config: Config) -> None:
    if found.body.names != model.joints or found.fps != model.fps:
        raise InputError(
            f"{config.concepts} holds {len(found.body.names)} joints at {found.fps:g} frames a second, and the "
            f"recogniser reads {len(model.joints)} at {model.fps:g}.",
            "Give the concepts artefact that it was trained on.",
        )


def _fit_cm(reader: ConceptsReader, config: Config) -> float:
    """Mean distance of the joints from the splines, in cm on the standard body, over the clips of the splits."""
    rows = [row for row in reader.clips if row.split in config.splits]
    if not rows:
        raise InputError(f"{reader.artefact.path} holds no clip of {', '.join(config.splits)}.", "Give --splits.")
    errors = [fit_error_cm(reader.segmented(row.clip)) for row in rows]
    return float(np.average(errors, weights=[row.frames for row in rows]))


def _table(measured: Mapping[str, Measured], counts: Mapping[str, int], fit_of: Mapping[str, float]) -> Table:
    rows = []
    for name, each in measured.items():
        base = measured.get(name.split(" + ")[0]) if " + " in name else None
        entries = [Entry(str(counts[name])), *(_entry(key, each, base) for key in _HEADS)]
        if fit_of:
            entries.append(Entry(f"{fit_of[name]:.2f}" if name in fit_of else ""))
        rows.append(Row((name,), tuple(entries)))
    fit = ("fit, cm",) if fit_of else ()
    empty = [Entry()] * (1 + len(_HEADS))
    rows += [Row((name,), (*empty, Entry(f"{value:.2f}"))) for name, value in fit_of.items() if name not in measured]
    return Table(("motions",), ("count", *_HEADS.values(), *fit), tuple(rows))


def _entry(key: str, each: Measured, base: Measured | None) -> Entry:
    if key not in each:
        return Entry()
    factor, digits = (100, 1) if key == "accuracy" else (1, 2)
    found = each[key]
    ratio = ""
    if key in _DISTANCES and base is not None and base[key].value > 0:
        ratio = f"×{found.value / base[key].value:.2f}"
    return Entry(f"{factor * found.value:.{digits}f}", f"±{factor * found.half_width:.{digits}f}", ratio)


def _rows(
    measured: Mapping[str, Measured], groups: Mapping[str, Features], fit_of: Mapping[str, float], found: ConceptSet
) -> Iterator[MetricRow]:
    own = ("all", found.body.id, "")
    for name, each in measured.items():
        count = len(groups[name].actions)
        for key, value in each.items():
            yield MetricRow(*own, name, "generation", 0, key, value.value, windows=count)
            yield MetricRow(*own, name, "generation", 0, f"{key}_half_width", value.half_width, windows=count)
    for name, value in fit_of.items():
        yield MetricRow(*own, name, "segmentation", 0, "fit_error_cm", value)


def _page(
    table: Table, model: RecogniserModel, groups: Mapping[str, Features], found: ConceptSet, config: Config
) -> str:
    held_out = "no held-out clips" if model.test_accuracy is None else f"{model.test_accuracy:.1%} on held-out clips"
    few = [name for name, each in groups.items() if len(each.actions) < FID_SAMPLES]
    drawn = f" Drawn with replacement, since there are fewer: {', '.join(few)}." if few else ""
    return (
        f"# Generated and refined motions\n\nMade by:\n\n```\n{command_line('pumps measure concepts', config)}\n```\n"
        f"\n{len(found.actions)} actions. The recogniser's accuracy: {held_out}. FID and A-FID are distances to the "
        f"real motions of {', '.join(config.splits)} (row {REAL}); a ratio compares a row with the row without "
        f"refinement. A figure is the mean of {config.repetitions} repetitions, ± half its 95 % interval. "
        f"A repetition draws {FID_SAMPLES} motions for FID and accuracy, {ACTION_SAMPLES} of each action for A-FID, "
        f"{DIVERSITY_PAIRS} pairs for diversity and {MULTIMODALITY_PAIRS} pairs of each action for multimodality."
        f"{drawn} The intervals say how much the draws vary, not how much another training would.\n\n"
        + "\n".join(table.markdown())
        + "\n"
    )
