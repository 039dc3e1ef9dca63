"""Which column of a table belongs to which joint of a skeleton, by their names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

_SEPARATORS = " _.-"
_END_WORDS = ("endsite", "end site", "end_site", "end", "nub")


def plain_name(name: str) -> str:
    """A name in lower case, without the namespace before its colon and without separators."""
    name = name.rsplit(":", 1)[-1].lower()
    return "".join(c for c in name if c not in _SEPARATORS and not c.isspace())


def sided_name(name: str) -> str:
    """A name in which each way to write a side reads the same: LHip, L_Hip, hip.l and left hip are one."""
    bare = name.rsplit(":", 1)[-1].strip()
    lower = bare.lower()
    for side, letter in (("left", "l"), ("right", "r")):
        if lower.startswith(side):
            return f"{side} {plain_name(bare[len(side) :])}"
        if lower.endswith(side):
            return f"{side} {plain_name(bare[: -len(side)])}"
        if lower.startswith(letter) and (bare[1:2] in _SEPARATORS or (bare[0].isupper() and bare[1:2].isupper())):
            return f"{side} {plain_name(bare[1:])}"
        if lower.endswith(letter) and bare[-2:-1] and bare[-2] in _SEPARATORS:
            return f"{side} {plain_name(bare[:-1])}"
    return plain_name(bare)


def matched(given: Sequence[str], joints: Sequence[str], aliases: Mapping[str, str] | None = None) -> list[int]:
    """For each given name the index of its joint, or -1.

    Names match as they are, else without case, separators and namespace, else with sides written in any way, else
    without the words that all given names begin with (`body_`). A name that fits several joints fits none, and a
    joint gets the first of the names that fit it.

    Args:
        aliases: plain name -> name of a joint.
    """
    found = _by_names(given, joints, aliases or {})
    start = _common_start(given)
    if start and 2 * sum(joint >= 0 for joint in found) < len(given):
        found = _by_names([name[len(start) :] for name in given], joints, aliases or {})
    return found


def _by_names(given: Sequence[str], joints: Sequence[str], aliases: Mapping[str, str]) -> list[int]:
    found = [-1] * len(given)
    taken: set[int] = set()
    ways: tuple[tuple[Callable[[str], str], Callable[[str], str]], ...] = (
        (str, str),
        (plain_name, plain_name),
        (sided_name, sided_name),
        (lambda name: aliases.get(plain_name(name), ""), str),
    )
    for way, way_of_joints in ways:
        keys = [way_of_joints(joint) for joint in joints]
        counts = Counter(keys)
        index = {key: at for at, key in enumerate(keys) if counts[key] == 1}
        for at, name in enumerate(given):
            joint = index.get(way(name), -1) if found[at] < 0 else -1
            if joint >= 0 and joint not in taken:
                found[at] = joint
                taken.add(joint)
    return found


def _common_start(names: Sequence[str]) -> str:
    """The words that all names begin with, up to a separator."""
    if len(names) < 3:
        return ""
    first, last = min(names), max(names)
    start = first[: next((at for at, c in enumerate(first) if c != last[at : at + 1]), len(first))]
    return start[: max(map(start.rfind, "_.: ")) + 1]


def end_of(name: str) -> str:
    """The joint whose end a name names (`RightFoot_End`, `Head End Site`), or ""."""
    lower = name.lower()
    for word in _END_WORDS:
        before = name[: -len(word)]
        if lower.endswith(word) and before and before[-1] in _SEPARATORS:
            return before.rstrip(_SEPARATORS)
    return ""
