"""The HIERARCHY part of a BVH: a bounded, non-recursive parser whose errors name joint and line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from stages.shared.formats.table_columns import decimal_commas_hint

MAX_JOINTS = 4096
POSITION_CHANNELS = ("Xposition", "Yposition", "Zposition")
ROTATION_CHANNELS = ("Xrotation", "Yrotation", "Zrotation")
_CHANNELS = {name.lower(): name for name in POSITION_CHANNELS + ROTATION_CHANNELS}


@dataclass(frozen=True)
class BvhJoint:
    """One joint of a BVH's header, in the file's own unit and axes.

    channels: canonical names ("Xposition", ...) in file order; `first_channel` is the column of the first in a row.
    end_site: offset of the joint's End Site, or None if the joint has children or no End Site.
    line:     1-based line of the joint's ROOT or JOINT word.
    """

    name: str
    parent: int
    offset: tuple[float, float, float]
    channels: tuple[str, ...]
    first_channel: int
    end_site: tuple[float, float, float] | None
    line: int


class HeaderFault(Exception):
    """A fault of a header and its line; the reader adds the file's name."""

    def __init__(self, line: int, message: str, hint: str | None = None):
        super().__init__(message)
        self.line = line
        self.message = message
        self.hint = hint


@dataclass
class _Open:
    """A joint whose closing brace has not been read yet; `index` is -1 for an End Site."""

    name: str
    index: int
    line: int
    offset: tuple[float, float, float] | None = None
    channels: tuple[str, ...] | None = None
    end_site: tuple[float, float, float] | None = None
    entered: bool = False


@lru_cache(maxsize=64)
def parse_header(header: str) -> tuple[BvhJoint, ...]:
    """Joints of a header, parents before children, in the order of their channels.

    Args:
        header: text from the start of the file up to the MOTION line.
    Raises: HeaderFault.
    """
    parser = _Parser()
    lines = header.lstrip("\ufeff").splitlines()
    for number, line in enumerate(lines, start=1):
        # A brace may touch another word ("Hips{"), so each brace is made a word of its own.
        parser.feed(line.replace("{", " { ").replace("}", " } ").split(), number)
    return parser.finish(len(lines))


class _Parser:
    def __init__(self) -> None:
        self.stack: list[_Open] = []
        self.joints: list[_Open] = []
        self.parents: list[int] = []
        self.names: dict[str, int] = {}
        self.seen_hierarchy = False

    def feed(self, words: list[str], line: int) -> None:
        """Parse one line's words; a line may hold several statements."""
        while words:
            word = words[0].upper()
            if word == "HIERARCHY":
                self.seen_hierarchy = True
                words = words[1:]
            elif not self.seen_hierarchy:
                raise HeaderFault(line, f"expected HIERARCHY and found '{words[0][:40]}'", "Is this a BVH file?")
            elif word in ("{", "}"):
                (self._enter if word == "{" else self._leave)(line)
                words = words[1:]
            elif word in ("ROOT", "JOINT"):
                words = self._open_joint(word, words, line)
            elif word in ("END", "ENDSITE"):
                words = self._open_end_site(words, line)
            elif word == "OFFSET":
                words = self._offset(words, line)
            elif word == "CHANNELS":
                words = self._channels(words, line)
            else:
                raise HeaderFault(line, f"'{words[0][:40]}' is not a keyword of a BVH hierarchy")

    def finish(self, line: int) -> tuple[BvhJoint, ...]:
        if self.stack:
            top = self.stack[-1]
            raise HeaderFault(
                line, f"joint '{top.name}' opened on line {top.line} is never closed", "Is it truncated?"
            )
        if not self.joints:
            raise HeaderFault(line, "there is no ROOT joint")
        out, column = [], 0
        for joint, parent in zip(self.joints, self.parents, strict=True):
            if joint.offset is None:
                raise HeaderFault(joint.line, f"joint '{joint.name}' has no OFFSET")
            channels = joint.channels or ()
            out.append(BvhJoint(joint.name, parent, joint.offset, channels, column, joint.end_site, joint.line))
            column += len(channels)
        if column == 0:
            raise HeaderFault(line, "no joint has any CHANNELS")
        return tuple(out)

    def _top(self, word: str, line: int) -> _Open:
        if not self.stack or not self.stack[-1].entered:
            raise HeaderFault(line, f"{word} is outside the braces of a joint")
        return self.stack[-1]

    def _enter(self, line: int) -> None:
        if not self.stack or self.stack[-1].entered:
            raise HeaderFault(line, "a '{' does not follow the name of a joint")
        self.stack[-1].entered = True

    def _leave(self, line: int) -> None:
        if not self.stack:
            raise HeaderFault(line, "a '}' has no matching '{'")
        top = self._top("'}'", line)
        self.stack.pop()
        if top.index < 0 and self.stack:
            self.stack[-1].end_site = top.offset

    def _open_joint(self, word: str, words: list[str], line: int) -> list[str]:
        cut = next((i for i, other in enumerate(words) if other in ("{", "}")), len(words))
        names, rest = words[1:cut], words[cut:]
        name = " ".join(names)  # names with blanks exist ("Bip01 L Thigh")
        if not name:
            raise HeaderFault(line, f"{word} has no name")
        if name in self.names:
            raise HeaderFault(
                line,
                f"joint '{name}' is defined twice, first on line {self.joints[self.names[name]].line}",
                "Rename one of the two.",
            )
        if word == "ROOT" and self.joints:
            raise HeaderFault(
                line,
                f"there is a second ROOT '{name}' after '{self.joints[0].name}'",
                "Split the file: one ROOT each.",
            )
        if word == "JOINT" and (not self.stack or self.stack[-1].index < 0):
            raise HeaderFault(line, f"JOINT '{name}' has no parent", "Write ROOT for the first joint.")
        if len(self.joints) >= MAX_JOINTS:
            raise HeaderFault(line, f"there are more than {MAX_JOINTS} joints")
        parent = self._top(word, line).index if self.stack else -1
        self.names[name] = len(self.joints)
        self.joints.append(_Open(name, len(self.joints), line))
        self.parents.append(parent)
        self.stack.append(self.joints[-1])
        return rest

    def _open_end_site(self, words: list[str], line: int) -> list[str]:
        parent = self._top("End Site", line)
        if parent.index < 0:
            raise HeaderFault(line, "an End Site is inside another End Site")
        self.stack.append(_Open(f"End Site of {parent.name}", -1, line))
        rest = words[1:]
        while rest and rest[0] != "{":  # "End Site", "EndSite" and "End Site name" all exist
            rest = rest[1:]
        return rest

    def _offset(self, words: list[str], line: int) -> list[str]:
        top = self._top("OFFSET", line)
        if top.offset is not None:
            raise HeaderFault(line, f"joint '{top.name}' has two OFFSETs")
        try:
            x, y, z = (float(word) for word in words[1:4])
        except ValueError:
            hint = next(filter(None, map(decimal_commas_hint, words[1:4])), None)
            raise HeaderFault(line, f"OFFSET of '{top.name}' needs three numbers, found {words[1:4]}", hint) from None
        if not all(math.isfinite(value) and abs(value) < 1e9 for value in (x, y, z)):
            raise HeaderFault(line, f"OFFSET of '{top.name}' is not finite or too large: {words[1:4]}")
        top.offset = (x, y, z)
        return words[4:]

    def _channels(self, words: list[str], line: int) -> list[str]:
        top = self._top("CHANNELS", line)
        if top.index < 0:
            raise HeaderFault(line, "an End Site has CHANNELS")
        if top.channels is not None:
            raise HeaderFault(line, f"joint '{top.name}' has two CHANNELS lines")
        count = int(words[1]) if len(words) > 1 and words[1].isascii() and words[1].isdigit() else -1
        if not 0 <= count <= 6:
            raise HeaderFault(line, f"CHANNELS of '{top.name}' needs a count of 0 to 6, found {words[1:2]}")
        found = words[2 : 2 + count]
        channels = tuple(_CHANNELS.get(word.lower(), "") for word in found)
        if len(channels) != count or "" in channels:
            raise HeaderFault(line, f"CHANNELS of '{top.name}' declares {count} channels, found {found}")
        if len(set(channels)) != count:
            raise HeaderFault(line, f"CHANNELS of '{top.name}' names a channel twice: {found}")
        top.channels = channels
        return words[2 + count :]
