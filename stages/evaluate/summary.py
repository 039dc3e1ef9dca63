"""`summary.md`: what was measured, how, and the tables."""

from __future__ import annotations

from collections.abc import Iterator

from data_schemas.manifest import Artefact
from data_schemas.metrics import MetricRow
from stages.evaluate.config import Config
from stages.evaluate.methods import RECONSTRUCTED, TRUE_CLOUD, LoadedWeights
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.feel_tables import LEGEND as FEEL_LEGEND
from stages.shared.statistics.feel_tables import feel_markdown
from stages.shared.statistics.tables import Cell, Key, overview, task_tables

LEGEND = (
    "In the tables below: mean [95% bootstrap interval over clips] ×ratio to slerp (in prediction to zero velocity) "
    "on the same windows, with a star where the ratio's own 95% interval leaves out 1. Lower is better. In the "
    "header: the windows and clips measured."
)


def summary_md(
    config: Config,
    motion: Artefact,
    rows: list[MetricRow],
    found: dict[Key, Cell],
    loaded: list[LoadedWeights],
    borrowed_statistics: list[str],
) -> str:
    """The whole Markdown page."""
    methods = dict.fromkeys(row.method for row in rows)
    parts = [
        "# Evaluation\n",
        f"{len({row.clip for row in rows})} clips ({_clips_text(config)}) of the motion artefact "
        f"`{motion.manifest.digest[:16]}`, at 30 frames a second; skeletons: {len({r.skeleton for r in rows})}; "
        f"{_windows_text(config)}; seed {config.seed}; protocol `{config.protocol}` (docs/evaluation.md defines "
        "every figure).\n",
        f"Made by:\n\n```\n{command_line('pumps evaluate', config)}\n```\n",
        *_method_notes(list(methods), loaded),
    ]
    if borrowed_statistics:
        parts.append(
            "No training clip is on the skeletons "
            f"{', '.join(borrowed_statistics)}: the LaFAN1 statistics are those of their measured clips.\n"
        )
    tables = task_tables(found, lambda scope: feel_markdown(found, scope))
    parts += [overview(found), LEGEND + "\n", *([FEEL_LEGEND + "\n"] if "### Feel" in tables else []), tables]
    return "\n".join(parts)


def _clips_text(config: Config) -> str:
    if config.unseen:
        return "all clips of archives that none of the weights were trained on"
    return f"{', '.join(config.splits)} split"


def _windows_text(config: Config) -> str:
    if not config.max_windows:
        return "all windows"
    return f"at most {config.max_windows} windows for each archive and task"


def _method_notes(methods: list[str], loaded: list[LoadedWeights]) -> Iterator[str]:
    notes = [
        f"- `{w.name}`: weights `{w.source}`, trained on {w.models.trained_on or 'no one says'}." for w in loaded
    ]
    if any(method.endswith(RECONSTRUCTED) for method in methods):
        notes.append(
            f"- `…{RECONSTRUCTED}`: the solve on the autoencoder's reconstruction of the true cloud, nothing masked: "
            "what is lost without the synthesiser."
        )
    if TRUE_CLOUD in methods:
        notes.append(f"- `{TRUE_CLOUD}`: the solve on the true cloud, no network: what the solve alone loses.")
    if notes:
        yield "\n".join(notes) + "\n"
