"""`pumps weights show`: licences, size, training, validation, strengths and weaknesses."""

from __future__ import annotations

from typing import Any

from stages.shared.contract import StageReport
from stages.shared.progress import SILENT, Progress
from stages.shared.weights.facts import VERDICT_WORDS, known_facts, verdicts
from stages.weights.show.config import Config


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Report the main facts in lines; the figures have all of them, and the card.

    Raises: InputError if there are no such weights, or they are damaged.
    """
    facts = known_facts(config.name)
    if "task" in facts:
        return _of_task(facts)
    parameters = facts["parameters"]
    lines = [
        f"{facts['name']}{' (default)' if facts['default'] else ''}: {facts['bytes'] / 1e6:.1f} MB in "
        f"{facts['folder']}; {sum(parameters.values()) / 1e6:.1f} M parameters.",
        f"Trained on {facts['trained_on']}; "
        + ", ".join(f"{part} {steps} steps" for part, steps in facts["steps"].items())
        + f"; gaps of up to {facts['longest_gap']} frames at 30 fps.",
        _digest_line(facts["digests"]),
        "Licences of the data, which the weights carry:",
        *[f"  {licence}" for licence in facts["licences"] or ["none stated"]],
        *_validation_lines(facts["validation"]),
        *_measured_lines(facts["measured"]),
    ]
    return StageReport(lines=lines, figures=facts)


def _of_task(facts: dict[str, Any]) -> StageReport:
    figures = ", ".join(f"{name} {value:.4g}" for name, value in facts["validation"].items())
    lines = [
        f"{facts['name']}: {facts['bytes'] / 1e6:.1f} MB in {facts['folder']}; {facts['parameters'] / 1e6:.1f} M "
        "parameters.",
        f"For the task {facts['task']} ({facts['corruption']}), on a rig of {facts['joints']} joints.",
        f"Trained on {facts['trained_on']}; {facts['steps']} steps.",
        _digest_line(facts["digests"]),
        "Licences of the data, which the weights carry:",
        *[f"  {licence}" for licence in facts["licences"] or ["none stated"]],
        *([f"Validation: {figures}."] if figures else []),
    ]
    return StageReport(lines=lines, figures=facts)


def _digest_line(digests: dict[str, str]) -> str:
    return "Digests: " + ", ".join(f"{part} {digest[:12]}" for part, digest in digests.items()) + "."


def _validation_lines(validation: dict[str, dict[str, float]]) -> list[str]:
    return [
        f"Validation of the {part}: " + ", ".join(f"{name} {value:.4g}" for name, value in figures.items()) + "."
        for part, figures in validation.items()
        if figures
    ]


def _measured_lines(measured: list[dict[str, Any]]) -> list[str]:
    found = verdicts(measured)
    if not any(found.values()):
        return ["Nothing was measured of them on test clips (pumps evaluate)."]
    lines = ["On test clips, L2P as a share of slerp's (in prediction: of a held pose's):"]
    lines += [f"  {VERDICT_WORDS[kind]}: {', '.join(tasks)}" for kind, tasks in found.items() if tasks]
    worst = max((row for row in measured if row["low"] is not None), key=lambda row: row["ratio"])
    lines.append(f"  Worst of all: {worst['task']} {worst['interval']} on {worst['scope']} ({worst['ratio']:.2f})")
    return lines
