"""How a command ends: its output, its exit code, and one sentence instead of a traceback."""

from __future__ import annotations

import json
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import typer

from data_schemas.errors import PumpsError
from data_schemas.old_names import OldName
from pumps_cli.interrupts import INTERRUPTED
from pumps_cli.terminal import COULD_NOT, NO_READER, interrupts_raised, say, say_aside, visible

if TYPE_CHECKING:
    from stages.shared.contract import StageReport

# What a line is about -> its style on a terminal: left limbs green and cyan, right limbs red and yellow.
TINTS = {
    "spine": "bold", "left_arm": "green", "right_arm": "red", "left_leg": "cyan", "right_leg": "yellow",
    "faint": "dim", "problem": "bold magenta",
}  # fmt: skip


@dataclass(frozen=True)
class Manner:
    """How to print: nothing but errors, JSON, tracebacks."""

    quiet: bool = False
    json: bool = False
    debug: bool = False


@contextmanager
def errors_reported(manner: Manner, command: str) -> Iterator[None]:
    """Turn every error inside into one sentence on stderr and an exit code (1, 2, 3; 130 when interrupted;
    141 when nobody reads its output)."""
    try:
        with interrupts_raised(), warnings.catch_warnings():
            if not manner.debug:
                warnings.simplefilter("ignore")  # libraries' warnings for programmers
                warnings.showwarning = _show_old_name
            warnings.simplefilter("always", OldName)
            yield
    except PumpsError as error:
        _fail(manner, error.message, error.hint, error.exit_code)
    except KeyboardInterrupt:
        _fail(manner, f"`{command}` was interrupted.", "What was finished is kept.", INTERRUPTED)
    except typer.Exit:
        raise
    except BrokenPipeError:
        raise typer.Exit(NO_READER) from None  # who read the output has read enough
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        _fail(manner, f"`{command}` could not go on: {error.strerror or error}{where}.", None, COULD_NOT)
    except MemoryError:
        _fail(manner, f"`{command}` ran out of memory.", "Give it fewer or shorter clips at a time.", COULD_NOT)
    except Exception as error:
        cause = f"{type(error).__name__}: {' '.join(str(error).split())}"
        _fail(manner, f"`{command}` failed: {cause}.", "This is a fault of pumps; --debug shows where.", COULD_NOT)


def _show_old_name(message: Warning | str, *where: object) -> None:
    """In the place of warnings.showwarning: one line, without the place in the code."""
    say_aside(str(message))


def _fail(manner: Manner, message: str, hint: str | None, code: int) -> None:
    if manner.debug:
        say_aside(traceback.format_exc())
    between = "\n" if "\n" in message else " "  # after a list of faults, a line of its own
    sentence = f"pumps: {message}" + (f"{between}{hint}" if hint else "")
    try:
        if manner.json:
            say(json.dumps({"error": message, "hint": hint, "exit_code": code}))
            sys.stdout.flush()  # a closed output raises OSError only when it is flushed
        else:
            say_aside(sentence)
    except OSError:  # stdout is closed or full
        say_aside(sentence)
    raise typer.Exit(code)


def show_report(manner: Manner, report: StageReport) -> None:
    """Print a stage's report: its lines for a person, coloured on a terminal, or all of it as one JSON object."""
    if report.tints and sys.stdout.isatty() and not (manner.json or manner.quiet):
        _print_tinted(report)
    else:
        show(manner, lambda: report.lines, lambda: report.model_dump(mode="json"))


def _print_tinted(report: StageReport) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)  # follows NO_COLOR and dumb terminals
    for index, line in enumerate(report.lines):
        console.print(Text(visible(line, one_line=True), style=TINTS.get(report.tints.get(index, ""), "")))


def show(manner: Manner, lines: Callable[[], list[str]], data: Callable[[], object]) -> None:
    """Print lines, JSON or nothing, as `manner` says. A line end inside a name is printed as its code."""
    if manner.json:
        say(json.dumps(data()))
    elif not manner.quiet:
        for line in lines():
            say(line, one_line=True)
