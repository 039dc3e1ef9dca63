"""The command `pumps`, also `python -m pumps_cli`: handles interrupts while it loads, and sets the exit code."""

from __future__ import annotations

import sys

from pumps_cli.interrupts import end_at_interrupt


def main() -> None:
    """Run `pumps` with the shell's arguments. Leaves by SystemExit with the exit code."""
    end_at_interrupt()
    # Imported only now, so that an interrupt during the import ends the program without a traceback.
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
