"""What is known of some weights, from their artefacts and what was measured of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from data_schemas.artefact import open_artefact
from data_schemas.checkpoint import Checkpoint, read_checkpoint
from data_schemas.damaged_files import reading
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact
from data_schemas.trainings import last_sentence, plain_trainings
from stages.shared.weights import shipped
from stages.shared.weights.fetched import fetched_folder
from stages.shared.weights.shipped import CARD_NAME, MEASURED_NAME, default_weights, parts_of, weights_folder
from stages.shared.weights.task_weights import is_of_task, task_weights

VERDICT_WORDS = {"better": "Good at", "alike": "No better and no worse at", "worse": "Bad at"}


def known_facts(name_or_path: str | Path) -> dict[str, Any]:
    """The facts of any weights: `task_facts_of` of those of one task (they have a `task`), `facts_of` of others."""
    return task_facts_of(name_or_path) if is_of_task(name_or_path) else facts_of(name_or_path)


def facts_of(name_or_path: str | Path) -> dict[str, Any]:
    """What is known of some weights: plain data, from their artefacts and what was measured of them.

    Returns: name, folder, default, licences, bytes, parameters, trained_on (one line on the last training's data),
        longest_gap (frames at 30 a second), digests (of the artefacts), trainings (`data_schemas.trainings`, as plain
        data), steps (of all trainings) and validation (figures of the steps that were kept), each of autoencoder and
        synthesiser, measured (a list of mappings as `pumps weights pack --measured` wrote it, or none) and card
        (Markdown, "" where there is none).
    Raises: InputError where there are no such weights, or they are damaged.
    """
    folder = weights_folder(name_or_path)
    artefacts = [open_artefact(path, "checkpoint") for path in parts_of(folder)]
    kept = [read_checkpoint(each, optimiser=False) for each in artefacts]
    parts = ("autoencoder", "synthesiser")
    name = _name_of(folder, name_or_path)
    return {
        "name": name,
        "folder": str(folder),
        "default": name == default_weights(),
        "licences": sorted({licence for each in artefacts for licence in each.manifest.licences}),
        "bytes": sum(_bytes(each) for each in artefacts),
        "parameters": {part: sum(v.size for v in k.weights.values()) for part, k in zip(parts, kept, strict=True)},
        "trained_on": last_sentence(kept[1].trainings),
        "longest_gap": int(kept[1].config.get("longest_gap", 0)),
        "digests": {part: each.manifest.digest for part, each in zip(parts, artefacts, strict=True)},
        "trainings": {part: plain_trainings(k.trainings) for part, k in zip(parts, kept, strict=True)},
        "steps": {part: sum(each.steps for each in k.trainings) for part, k in zip(parts, kept, strict=True)},
        "validation": {part: _best(k.log) for part, k in zip(parts, kept, strict=True)},
        "measured": _measured(folder),
        "card": _text(folder / CARD_NAME),
    }


def check_of_task(kept: Checkpoint, folder: str | Path) -> None:
    """Raise InputError unless a checkpoint is of a network for one task."""
    if "task" not in kept.config:
        raise InputError(
            f"{folder} holds no network that was fine-tuned for a task.",
            "Give the folder that holds both ae and lms.",
        )


def task_facts_of(name_or_path: str | Path) -> dict[str, Any]:
    """What is known of the weights of one task: plain data, from their checkpoint.

    Returns: name, folder, task, corruption, joints (of the rig), licences, bytes, parameters, trained_on, digests (of
        the artefact, by the task), steps (of all trainings), validation (figures of the steps that were kept) and
        card (Markdown).
    Raises: InputError where there are no such weights, or they are damaged.
    """
    folder = task_weights(name_or_path)
    artefact = open_artefact(folder, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    check_of_task(kept, folder)
    rig = kept.config.get("rig")
    names = rig.get("skeleton", {}).get("names", []) if isinstance(rig, dict) else []
    return {
        "name": _name_of(folder, name_or_path),
        "folder": str(folder),
        "task": str(kept.config["task"]),
        "corruption": str(kept.config.get("corruption", "")),
        "joints": len(names),
        "licences": sorted(artefact.manifest.licences),
        "bytes": _bytes(artefact),
        "parameters": sum(value.size for value in kept.weights.values()),
        "trained_on": last_sentence(kept.trainings),
        "digests": {str(kept.config["task"]): artefact.manifest.digest},
        "steps": sum(each.steps for each in kept.trainings),
        "validation": {
            name: value for name, value in kept_validation(kept.log).items() if name not in ("split", "seconds")
        },
        "card": kept.card,
    }


def kept_validation(log: list[dict[str, Any]]) -> dict[str, Any]:
    """The validation of a task's kept weights: that of the least `mpjpe_mm`; empty if there is none."""
    validations = (row for row in log if row.get("split") == "val")
    return min(validations, key=lambda row: row.get("mpjpe_mm", 0.0), default={})


def verdicts(measured: list[dict[str, Any]]) -> dict[str, list[str]]:
    """Tasks by how they compare with the plain baseline over all archives: `better` and `worse` where the ratio's 95%
    interval leaves out 1, else `alike`."""
    scopes = list(dict.fromkeys(row["scope"] for row in measured))
    scope = "all archives" if "all archives" in scopes else next(iter(scopes), "")
    found: dict[str, list[str]] = {kind: [] for kind in VERDICT_WORDS}
    for row in measured:
        if row["scope"] == scope and row["low"] is not None:
            kind = "better" if row["high"] < 1 else "worse" if row["low"] > 1 else "alike"
            found[kind].append(f"{row['task']} {row['interval']} ({row['ratio']:.2f})")
    return found


def _name_of(folder: Path, given: str | Path) -> str:
    """The name of shipped and fetched weights; the path of others, as it was given."""
    return folder.name if folder.parent in (shipped.SHIPPED, fetched_folder()) else str(given)


def _bytes(artefact: Artefact) -> int:
    return sum(path.stat().st_size for path in artefact.folder.iterdir() if path.is_file())


def _best(log: list[dict[str, Any]]) -> dict[str, float]:
    rows = [row for row in log if row.get("split") == "val" and "score" in row]
    best = min(rows, key=lambda row: row["score"], default={})
    return {name: value for name, value in best.items() if name not in ("split", "seconds")}


def _measured(folder: Path) -> list[dict[str, Any]]:
    path = folder / MEASURED_NAME
    if not path.is_file():
        return []
    with reading(path):
        rows = json.loads(path.read_text(encoding="utf-8"))
        wanted = {"scope", "task", "interval", "baseline", "ratio", "low", "high", "windows"}
        if not isinstance(rows, list) or not all(isinstance(row, dict) and wanted <= row.keys() for row in rows):
            raise ValueError("it is not a list of what was measured")
    return rows


def _text(path: Path) -> str:
    if not path.is_file():
        return ""
    with reading(path):
        return path.read_text(encoding="utf-8")
