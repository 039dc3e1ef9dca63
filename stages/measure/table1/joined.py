"""Evaluations of the same windows, joined: their rows, and what is known about each method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from data_schemas.errors import InputError
from data_schemas.manifest import Artefact, open_artefact
from data_schemas.metrics import MetricRow, read_metrics
from stages.shared.statistics.measurements import TRUTH
from stages.shared.statistics.method_notes import MeasuredWeights, MethodFacts


@dataclass
class Joined:
    """Rows of all methods, the facts of their weights, and each method's milliseconds a frame."""

    artefacts: list[Artefact] = field(default_factory=list)
    rows: list[MetricRow] = field(default_factory=list)
    weights: dict[str, MeasuredWeights] = field(default_factory=dict)
    milliseconds: dict[str, float] = field(default_factory=dict)
    windows: dict[tuple[str, str, str, int], int] = field(default_factory=dict)  # archive, clip, task, interval

    @property
    def methods(self) -> list[str]:
        """The methods in order, the truth left out."""
        return [name for name in dict.fromkeys(row.method for row in self.rows) if name != TRUTH]


def joined(paths: Sequence[Path], like: Joined | None = None) -> Joined:
    """The evaluations as one.

    Raises: InputError if two measured other windows than each other or than those of `like`, or one method twice.
    """
    found = Joined(windows=like.windows if like else {})
    first = like.artefacts[0].path if like else paths[0]
    for path in paths:
        artefact = open_artefact(path, "metrics")
        rows, _ = read_metrics(artefact)
        here = {(row.archive, row.clip, row.task, row.interval): row.windows for row in rows}
        if found.windows and here != found.windows:
            raise InputError(
                f"{path} measured other windows than {first}.",
                "Give evaluations of the same motions, tasks, categories and max_windows.",
            )
        found.windows = here
        twice = {row.method for row in rows} & set(found.methods)
        if twice:
            raise InputError(f"{path} measures {sorted(twice)[0]} again.", "Give every method once.")
        found.artefacts.append(artefact)
        kept = [row for row in rows if row.method != TRUTH or not any(r.method == TRUTH for r in found.rows)]
        found.rows += kept
        summary = artefact.manifest.summary
        found.weights |= {each.name: each for each in MethodFacts.model_validate(summary).weights}
        spent = summary.get("milliseconds_per_frame")
        if isinstance(spent, dict):
            found.milliseconds |= {str(name): float(value) for name, value in spent.items()}
    return found
