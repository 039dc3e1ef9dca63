"""The command that repeats what a stage did, for its page."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from stages.shared.contract import StageConfig


def command_line(command: str, config: StageConfig, *, arguments: tuple[str, ...] = ()) -> str:
    """`command` with its arguments, and flags for all that differs from the defaults and changes the result.

    Args:
        arguments: settings that are given without a flag, in their order.
    """
    given = [shlex.quote(str(getattr(config, name))) for name in arguments]
    return " ".join([command, *given, *_flags(config, arguments)])


def _flags(config: StageConfig, arguments: tuple[str, ...]) -> Iterator[str]:
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if field.exclude or name in arguments or value == field.default:
            continue
        flag = f"--{name.rstrip('_').replace('_', '-')}"
        if isinstance(value, bool):
            yield flag if value else f"--no-{flag[2:]}"
        else:
            for item in value if isinstance(value, tuple) else (value,):
                yield f"{flag} {shlex.quote(str(item))}"
