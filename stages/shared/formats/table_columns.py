"""Column names of text tables: the joint and the axis that a column holds (`Hips.x`, `Hips_Z (mm)`, `Hips.rot.y`).

Names are taken apart character by character, in time proportional to their length. A pattern that tries separators in
every way takes minutes for a name of a hundred thousand dashes.
"""

from __future__ import annotations

from dataclasses import dataclass

from stages.shared.formats.text_cells import texts_of_line

_SEPARATORS = " \t._:/-"
_CLOSING = {")": "(", "]": "["}
_AXES = "xyz"
PLACE = "place"
_KINDS = {
    **dict.fromkeys(("position", "positions", "pos", "translation", "trans", "location", "loc"), PLACE),
    **dict.fromkeys(("rotation", "rotations", "rot", "angle", "angles", "euler", "orientation", "orient"), "angles"),
    **dict.fromkeys(("quaternion", "quat", "q"), "quaternions"),
    **dict.fromkeys(("velocity", "vel", "acceleration", "accel", "acc"), "velocities"),
}
_TRC_START = b"PathFileType"
_LONGEST_KIND = max(map(len, _KINDS))


@dataclass(frozen=True)
class Column:
    """What a column holds: of this joint, on this axis (x, y, z, or w of a quaternion), a value of this kind."""

    joint: str
    axis: str
    kind: str = PLACE


def column_named(name: str) -> Column | None:
    """The joint, axis and kind that a column's name states; None if it names no axis."""
    text = name.strip()
    if column := _with_axis(text):
        return column
    opening = _CLOSING.get(text[-1:])  # a unit, such as "(m)"
    at = text.rfind(opening) if opening else -1
    return _with_axis(text[:at].rstrip()) if at > 0 else None


def looks_like_places(start: bytes) -> bool:
    """Whether the first line of a file's start names the x, y and z of a place."""
    head = start.replace(b"\r", b"\n").partition(b"\n")[0].decode("utf-8", errors="replace")
    axes: dict[str, set[str]] = {}
    for cell in texts_of_line(head, separator_of(head)):
        column = column_named(cell)
        if column and column.kind == PLACE:
            axes.setdefault(column.joint, set()).add(column.axis)
    return any(len(found) == 3 for found in axes.values())


def looks_trc(start: bytes) -> bool:
    """Whether a file's start is that of a .trc."""
    return start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(_TRC_START)


def _with_axis(text: str) -> Column | None:
    if text.endswith(")") and text[-3:-2] == "(":
        axis, before = text[-2], text[:-3]
    else:
        axis, before = text[-1:], text[:-1]
    axis = axis.lower()
    joint = before.rstrip(_SEPARATORS)
    if not joint or not axis or axis not in _AXES + "w":
        return None
    word = _last_word(joint)
    kind = _KINDS.get(word.lower(), PLACE)
    if word.lower() in _KINDS:
        joint = joint[: len(joint) - len(word)].rstrip(_SEPARATORS) or joint
    if axis == "w" and kind != "quaternions":
        return None
    return Column(joint, axis, kind)


def _last_word(text: str) -> str:
    """What follows the last separator, or "" if it is longer than any word that names a kind."""
    start = max(len(text) - _LONGEST_KIND - 1, 0)
    tail = text[start:]
    at = max(map(tail.rfind, _SEPARATORS))
    return tail[at + 1 :] if at >= 0 else ""


def separator_of(line: str) -> str:
    """The separator that stands most often in a line."""
    return max((";", "\t", ","), key=line.count)


def decimal_commas_hint(cell: str) -> str | None:
    """The hint for a word that is a number but for its decimal comma; None for any other word."""
    whole, comma, decimals = cell.strip().lstrip("+-").partition(",")
    if comma and whole.isdecimal() and decimals[:1].isdecimal() and "," not in decimals:
        return DECIMAL_COMMAS
    return None


DECIMAL_COMMAS = "Its decimals seem to be written with commas; use points."
