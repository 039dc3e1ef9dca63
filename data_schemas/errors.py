"""The errors of pumps: one sentence that names the file, line or field, and a hint how to correct it."""

from __future__ import annotations


class PumpsError(Exception):
    """An error that pumps reports to the user. The command line prints it and exits with `exit_code`.

    Args:
        message: the fault, with the file, line, field or frame, and the expected and found values.
        hint: how the user can correct it; a full sentence, or None.
    """

    exit_code = 1

    def __init__(self, message: str, hint: str | None = None):
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return self.message if self.hint is None else f"{self.message} {self.hint}"


class UsageError(PumpsError):
    """The options of a command are invalid or contradict each other (exit code 2)."""

    exit_code = 2


class InputError(PumpsError):
    """An input file is bad: truncated, of the wrong kind, out of range, not a humanoid (exit code 3)."""

    exit_code = 3
