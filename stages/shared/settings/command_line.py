"""The command that repeats what a stage did, for its page."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from stages.shared.contract import StageConfig


def command_line(command: str, config: StageConfig) -> str:
    """`command` with flags for all that differs from the defaults and changes the result."""
    return " ".join([command, *_flags(config)])


def _flags(config: StageConfig) -> Iterator[str]:
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if field.exclude or value == field.default:
            continue
        flag = f"--{name.replace('_', '-')}"
        if isinstance(value, bool):
            yield flag if value else f"--no-{flag[2:]}"
        else:
            for item in value if isinstance(value, tuple) else (value,):
                yield f"{flag} {shlex.quote(str(item))}"
