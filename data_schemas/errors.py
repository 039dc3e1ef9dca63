"""The errors of pumps: one sentence that names the file, line or field, and a hint that says the mend."""

from __future__ import annotations


class PumpsError(Exception):
    """Something pumps could not do. The command line prints it as one sentence and leaves with `exit_code`.

    Args:
        message: what is wrong, naming the file, line, field or frame, expected and found.
        hint: what the user can do about it; a full sentence, or None.
    """

    exit_code = 1

    def __init__(self, message: str, hint: str | None = None):
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return self.message if self.hint is None else f"{self.message} {self.hint}"


class UsageError(PumpsError):
    """The command was asked for something that its options cannot mean (exit code 2)."""

    exit_code = 2


class InputError(PumpsError):
    """A file that was given is bad: truncated, of the wrong kind, out of range, not a humanoid (exit code 3)."""

    exit_code = 3
