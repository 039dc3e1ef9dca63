"""`pumps weights list`: the weights that come with pumps, and those that were fetched."""

from __future__ import annotations

from typing import Any

from stages.shared.contract import StageReport
from stages.shared.progress import SILENT, Progress
from stages.shared.weights.facts import facts_of, known_facts, task_facts_of
from stages.shared.weights.fetched import fetched_weights
from stages.shared.weights.shipped import shipped_weights
from stages.shared.weights.task_weights import shipped_task_weights
from stages.weights.list.config import Config


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Report name, size, licences and training data of each; the default is marked.

    Raises: InputError if weights are damaged.
    """
    found = {name: facts_of(name) for name in shipped_weights()}
    found |= {name: task_facts_of(name) for name in shipped_task_weights()}
    found |= {name: known_facts(name) for name in fetched_weights() if name not in found}
    lines = []
    for name, facts in found.items():
        lines += [
            f"{name:12}{facts['bytes'] / 1e6:5.1f} MB  {_use(facts)}",
            f"{'':12}trained on {facts['trained_on']}",
            *[f"{'':12}licence: {licence}" for licence in facts["licences"]],
        ]
    lines.append("More of one: pumps weights show NAME" if found else "No weights are shipped or fetched.")
    shown = {
        name: {key: value for key, value in facts.items() if key not in ("card", "measured")}
        for name, facts in found.items()
    }
    return StageReport(lines=lines, figures={"weights": shown})


def _use(facts: dict[str, Any]) -> str:
    if "task" in facts:
        return f"for the task {facts['task']}, rig of {facts['joints']} joints"
    return f"gaps of up to {facts['longest_gap']} frames at 30 fps{'  (default)' if facts['default'] else ''}"
