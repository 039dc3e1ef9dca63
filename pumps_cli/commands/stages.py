"""`pumps stages`: the list of stages."""

from __future__ import annotations

from pumps_cli.outcome import Manner, errors_reported, show
from pumps_cli.stage_command import AsJson, Quiet
from stages.registry import STAGES, Stage

EXAMPLE = "Example: pumps stages"


def command(quiet: Quiet = False, as_json: AsJson = False) -> None:
    """List the stages in order, with what each reads and writes."""
    manner = Manner(quiet=quiet, json=as_json)
    with errors_reported(manner, "pumps stages"):
        show(manner, _table, lambda: [_plain(stage) for stage in STAGES])


def _table() -> list[str]:
    rows = [("command", "reads", "writes", "what it does")]
    rows += [(" ".join(s.command), ", ".join(s.reads), s.writes, s.summary) for s in STAGES]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    return ["  ".join([*(row[c].ljust(widths[c]) for c in range(3)), row[3]]).rstrip() for row in rows]


def _plain(stage: Stage) -> dict[str, object]:
    return {
        "name": stage.name, "command": list(stage.command), "reads": list(stage.reads), "writes": stage.writes,
        "needs": list(stage.needs), "summary": stage.summary,
    }  # fmt: skip
