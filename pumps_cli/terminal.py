"""Output to the terminal: control characters are escaped, any encoding works, a closed output gives an exit code.

Imports nothing that is slow, since it is needed before the command is loaded.
"""

from __future__ import annotations

import io
import os
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from pumps_cli.interrupts import end_program

NO_READER = 141  # 128 and the number of SIGPIPE
COULD_NOT = 1

# C0 and C1 controls and DEL; marks of text direction; line and paragraph separators; halves of surrogate pairs, which
# stand for bytes of a file's name that are not UTF-8.
_CONTROLS = "\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_UNSEEN = re.compile(f"[{_CONTROLS}]")
_UNSEEN_IN_LINE = re.compile(f"[{_CONTROLS}\n\t]")


def visible(text: str, *, one_line: bool = False) -> str:
    r"""The text with every character that would steer a terminal written as its code, such as `\x1b`.

    Args:
        one_line: whether line ends and tabs are written as their codes, too.
    """
    return (_UNSEEN_IN_LINE if one_line else _UNSEEN).sub(_code, text)


def say(text: str, *, one_line: bool = False) -> None:
    """Print a text on stdout. Raises OSError where it cannot be written."""
    print(visible(text, one_line=one_line))


def say_aside(text: str) -> None:
    """Print a text on stderr; where that is closed or full, the text is lost."""
    with suppress(OSError):
        print(visible(text), file=sys.stderr, flush=True)


def write_any_text() -> None:
    """Let stdout and stderr write characters that their encoding lacks as codes."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def open_closed_streams() -> None:
    """Open the standard streams that the shell closed, so that no file opened later gets their numbers.

    Writing to a closed stdout remains an error; what goes to a closed stderr is lost.
    """
    for number, (name, way) in enumerate((("stdin", os.O_RDONLY), ("stdout", os.O_RDONLY), ("stderr", os.O_WRONLY))):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, way)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
            stream = open(number, "w" if number else "r", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)


def ended(code: int, failure: OSError | None = None) -> int:
    """Flush stdout, and give the exit code: of usual tools, where its reader has gone or it cannot be written."""
    try:
        if failure is not None:
            raise failure
        sys.stdout.flush()
    except BrokenPipeError:
        code = NO_READER
    except OSError as error:
        if not code:
            say_aside(f"pumps: The output could not be written: {error.strerror or error}.")
            code = COULD_NOT
    else:
        return code
    with suppress(OSError, ValueError):  # what is left to be written goes nowhere, so that Python does not complain
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code


@contextmanager
def interrupts_raised() -> Iterator[None]:
    """Inside, an interrupt raises KeyboardInterrupt, so that what is unfinished is put in order."""
    if signal.getsignal(signal.SIGINT) is not end_program:  # called by another program, which has its own way
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, end_program)


def _code(found: re.Match[str]) -> str:
    number = ord(found[0])
    return f"\\x{number:02x}" if number < 256 else f"\\u{number:04x}"
