"""`python -m pumps_cli` is `pumps`: what holds before the command is loaded, and after all is printed."""

from __future__ import annotations

import sys

from pumps_cli.interrupts import end_at_interrupt


def main() -> None:
    """Run `pumps` with the shell's arguments. Leaves by SystemExit with the exit code."""
    end_at_interrupt()
    # Only now: an interrupt while these are loaded ends the program without a traceback.
    from pumps_cli.terminal import ended, open_closed_streams

    open_closed_streams()
    from pumps_cli.app import main as run

    code, failure, stdout = 0, None, sys.stdout
    try:
        run()
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
    except OSError as error:  # of a help page; a command reports its own
        failure = error
    if sys.stdout is not stdout:  # typer found that nobody reads it, and put a wrapper around it
        failure = BrokenPipeError()
    sys.exit(ended(code, failure))


if __name__ == "__main__":
    main()
