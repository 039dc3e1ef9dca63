"""`summary.md`: the measured data, the method of measurement, and the tables."""

from __future__ import annotations

from data_schemas.manifest import Artefact
from data_schemas.metrics import MetricRow
from stages.evaluate.config import Config
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.feel_tables import LEGEND as FEEL_LEGEND
from stages.shared.statistics.feel_tables import feel_markdown, feel_table
from stages.shared.statistics.method_notes import MethodFacts, borrowed_note, markdown_of, method_notes
from stages.shared.statistics.pop_tables import LEGEND as POP_LEGEND
from stages.shared.statistics.pop_tables import pop_markdown
from stages.shared.statistics.tables import LEGEND, Cell, Key, overview, scopes_of, task_tables


def summary_md(
    config: Config,
    motion: Artefact,
    rows: list[MetricRow],
    found: dict[Key, Cell],
    facts: MethodFacts,
) -> str:
    """The whole Markdown page."""
    notes = method_notes(facts)
    parts = [
        "# Evaluation\n",
        f"{len({row.clip for row in rows})} clips ({_clips_text(config)}) of the motion artefact "
        f"`{motion.manifest.digest[:16]}`, at 30 frames a second; skeletons: {len({r.skeleton for r in rows})}; "
        f"{_windows_text(config)}; seed {config.seed}; protocol `{config.protocol}` (docs/evaluation.md defines "
        "every figure).\n",
        f"Made by:\n\n```\n{command_line('pumps evaluate', config)}\n```\n",
    ]
    if notes:
        parts.append("\n".join(f"- {markdown_of(note)}" for note in notes) + "\n")
    if borrowed := borrowed_note(facts):
        parts.append(borrowed + "\n")
    pops = {scope: pop_markdown(rows, scope) for scope in scopes_of(found)}

    def beside(scope: str) -> str:
        return "\n".join(text for text in (feel_markdown(found, scope), pops[scope]) if text)

    tables = task_tables(found, beside)
    felt = any(feel_table(found, scope) for scope in scopes_of(found))
    legends = [LEGEND, *([FEEL_LEGEND] if felt else []), *([POP_LEGEND] if any(pops.values()) else [])]
    parts += [overview(found), *(f"{legend}\n" for legend in legends), tables]
    return "\n".join(parts)


def _clips_text(config: Config) -> str:
    if config.unseen:
        return "all clips of archives that none of the weights were trained on"
    return f"{', '.join(config.splits)} split"


def _windows_text(config: Config) -> str:
    if not config.max_windows:
        return "all windows"
    return f"at most {config.max_windows} windows for each archive and task"
