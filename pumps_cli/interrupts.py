"""An interrupt (Ctrl-C) before and after a command's work. It is imported first, and imports next to nothing."""

from __future__ import annotations

import os
import signal

INTERRUPTED = 130  # 128 and the number of SIGINT, as shells report it


def end_at_interrupt() -> None:
    """Let an interrupt end the program at once and without a word."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_program)


def end_program(number: int, frame: object) -> None:
    """The handler of such an interrupt."""
    os._exit(INTERRUPTED)
