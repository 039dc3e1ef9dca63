"""The action of a clip, from the name of its file: the labels that data sets of actions put there."""

from __future__ import annotations

import re

from data_schemas.clips import ClipRow
from data_schemas.errors import UsageError

AUTO = "auto"
HUMANACT12 = (
    "warm_up", "walk", "run", "jump", "drink", "lift_dumbbell", "sit", "eat", "turn_steering_wheel", "phone",
    "boxing", "throw",
)  # fmt: skip

# Bandai Namco: dataset-1_<content>_<style>_001. HDM05: HDM_bd_<action><Repetitions>_001_120; the repetitions are
# numbers and words at the end, such as 3Reps. The paper on motion concepts uses neither: they are open.
_PATTERNS = (
    re.compile(r"dataset-\d+_(?P<action>[a-z-]+?)_[a-z-]+_\d+"),
    re.compile(r"HDM_[a-z]{2}_(?P<action>[A-Za-z]{1,60})(?:\d\w{0,40}?)?_\d{3}_120"),
)
_GENERATED = re.compile(r"generated_(?P<action>.{1,200})_\d{5,9}", re.DOTALL)
HUMANACT12_NAME = re.compile(r"P(?P<subject>\d+)G\d+R\d+F\d+T\d+A(?P<coarse>\d\d)\d\d")


def action_pattern(text: str) -> re.Pattern[str] | None:
    """A user's pattern of the action in a source's path; None for `AUTO`.

    Raises: UsageError if it is no regular expression with a group.
    """
    if text == AUTO:
        return None
    try:
        pattern = re.compile(text)
    except re.error as error:
        raise UsageError(
            f"--actions {text!r} is not a regular expression: {error}.", "Try for instance '_([a-z]+)_'."
        ) from None
    if not pattern.groups:
        raise UsageError(f"--actions {text!r} has no group.", "Put the action in parentheses, such as '_([a-z]+)_'.")
    return pattern


def action_of(row: ClipRow, pattern: re.Pattern[str] | None = None) -> str:
    """The action of a clip, "" if its source's name holds none.

    Args:
        pattern: of the user; its first group is the action. None for the data sets that pumps knows.
    """
    if pattern is None and (made := _GENERATED.fullmatch(row.source)):
        return made["action"]
    source = row.source.replace("\\", "/")
    if pattern is not None:
        found = pattern.search(source)
        return (found[1] or "") if found else ""
    name = source.rpartition("/")[2].rpartition("!")[2]
    for known in _PATTERNS:
        if found := known.search(name):
            return found["action"]
    if found := HUMANACT12_NAME.search(name):
        coarse = int(found["coarse"])
        return HUMANACT12[coarse - 1] if 1 <= coarse <= len(HUMANACT12) else ""
    return ""


def generated_source(action: str, number: int) -> str:
    """The source of a motion that a network generated, which holds its action."""
    return f"generated_{action}_{number:05d}"
