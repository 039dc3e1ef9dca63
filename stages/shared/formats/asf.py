"""The skeleton file of Acclaim's ASF/AMC: bones, each with a direction, a length and axes of its own.

The format's definition (Acclaim 1.10, Vicon's remarks on it): a bone starts at its parent's end and lies along
`direction`, given in world axes at rest. Its motion M is given about axes tilted by the rotation C of `axis`:
M' = C M C^-1. Rotations are about fixed axes, in the order of the tokens. CMU's lengths are inches divided by its
`length`, 0.45.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache

from data_schemas.errors import InputError
from stages.shared.formats.recording import MAX_JOINTS

MAX_ASF_BYTES = 4 << 20
_INCH_M = 0.0254
_TRANSLATIONS, _ROTATIONS = ("tx", "ty", "tz"), ("rx", "ry", "rz")
_CHANNELS = (*_TRANSLATIONS, *_ROTATIONS, "l")


@dataclass(frozen=True)
class AsfBone:
    """One bone. channels: those of its AMC lines, in order ("rx", ...). axis: degrees about the axes `axis_order`.

    Bone 0 is the root, which has no length; the ASF states the order of its channels.
    """

    name: str
    parent: int
    vector: tuple[float, float, float]
    axis: tuple[float, float, float]
    axis_order: str
    channels: tuple[str, ...]


@dataclass(frozen=True)
class AsfSkeleton:
    """bones: parents first. unit_m: metres in a unit of length. in_degrees: the default for AMC files."""

    bones: tuple[AsfBone, ...]
    unit_m: float
    in_degrees: bool
    root_position: tuple[float, float, float]


@lru_cache(maxsize=64)
def read_asf(data: bytes, name: str) -> AsfSkeleton:
    """Parse an ASF. Raises InputError naming file and line."""
    if len(data) > MAX_ASF_BYTES:
        raise InputError(f"{name} has {len(data) / 1e6:.0f} MB, which is not a skeleton file.")
    if b"\0" in data:
        raise InputError(f"{name} is not plain text.", "Is this an ASF file?")
    reader = _Reader(name)
    for number, line in enumerate(data.decode("utf-8", errors="replace").lstrip("\ufeff").splitlines(), start=1):
        reader.line = number
        reader.feed(re.sub(r"[(),]", " ", line.partition("#")[0]).split())
    return reader.finish()


@dataclass
class _Block:
    """A bone's entry, between its lines `begin` and `end`."""

    line: int
    name: str = ""
    direction: tuple[float, ...] = ()
    length: float = math.nan
    axis: tuple[float, ...] = (0.0, 0.0, 0.0)
    axis_order: str = "xyz"
    channels: tuple[str, ...] = ()


class _Reader:
    def __init__(self, name: str) -> None:
        self.name = name
        self.line = 1
        self.section = ""
        self.block: _Block | None = None
        self.blocks: dict[str, _Block] = {}
        self.children: dict[str, list[str]] = {}
        self.parent_of: dict[str, str] = {}
        self.length, self.degrees = 1.0, True
        self.root_order: tuple[str, ...] = (*_TRANSLATIONS, *_ROTATIONS)
        self.root_axis, self.root_position, self.root_orientation = "xyz", (0.0,) * 3, (0.0,) * 3

    def fail(self, message: str, hint: str | None = None) -> InputError:
        return InputError(f"{self.name}, line {self.line}: {message}.", hint)

    def feed(self, words: list[str]) -> None:
        if not words:
            return
        if words[0].startswith(":"):
            self.section = words[0].lower()
            if self.block is not None:
                raise self.fail(f"bone '{self.block.name}' has no end before {words[0][:40]}", "Is it truncated?")
        elif self.section == ":units":
            self.units(words)
        elif self.section == ":root":
            self.root(words)
        elif self.section == ":bonedata":
            self.bone(words)
        elif self.section == ":hierarchy":
            self.hierarchy(words)

    def units(self, words: list[str]) -> None:
        if words[0].lower() == "length":
            (self.length,) = self.numbers(words, 1)
            if not 1e-6 < self.length < 1e6:
                raise self.fail(f"the unit of length is {self.length:g}")
        elif words[0].lower() == "angle" and len(words) > 1:
            self.degrees = not words[1].lower().startswith("rad")

    def root(self, words: list[str]) -> None:
        key = words[0].lower()
        if key == "order":
            self.root_order = self.channels(words)
        elif key == "axis":
            self.root_axis = self.order(words[1:2])
        elif key in ("position", "orientation"):
            setattr(self, f"root_{key}", self.numbers(words, 3))

    def bone(self, words: list[str]) -> None:
        key = words[0].lower()
        if key == "begin":
            if self.block is not None:
                raise self.fail(f"a bone begins inside the bone '{self.block.name}'")
            if len(self.blocks) >= MAX_JOINTS:
                raise self.fail(f"there are more than {MAX_JOINTS} bones")
            self.block = _Block(self.line)
            return
        if self.block is None:
            raise self.fail(f"'{words[0][:40]}' is outside begin and end")
        if key == "end":
            self.close(self.block)
            self.block = None
        elif key == "name":
            self.block.name = " ".join(words[1:])
        elif key == "direction":
            self.block.direction = self.numbers(words, 3)
        elif key == "length":
            (self.block.length,) = self.numbers(words, 1)
        elif key == "axis":
            self.block.axis = self.numbers(words, 3)
            self.block.axis_order = self.order(words[4:5] or ["xyz"])
        elif key == "dof":
            self.block.channels = self.channels(words)

    def close(self, block: _Block) -> None:
        name = block.name.lower()
        if not name:
            raise self.fail(f"the bone that begins on line {block.line} has no name")
        if name in self.blocks or name == "root":
            raise self.fail(f"bone '{block.name}' is defined twice")
        if not block.direction or math.isnan(block.length):
            raise self.fail(f"bone '{block.name}' has no direction or no length")
        self.blocks[name] = block

    def hierarchy(self, words: list[str]) -> None:
        if words[0].lower() in ("begin", "end") and len(words) == 1:
            return
        parent, *children = (word.lower() for word in words)
        for child in children:
            if child in self.parent_of or child == "root":
                raise self.fail(f"bone '{child[:60]}' has two parents")
            if child not in self.blocks:
                raise self.fail(f"bone '{child[:60]}' is not defined in :bonedata")
            self.parent_of[child] = parent
            self.children.setdefault(parent, []).append(child)

    def finish(self) -> AsfSkeleton:
        if self.block is not None:
            raise self.fail(f"bone '{self.block.name}' has no end", "Is it truncated?")
        if not self.blocks or "root" not in self.children:
            raise self.fail("there are no bones below a root", "Is this an ASF file?")
        bones: list[AsfBone] = []
        waiting = [("root", -1)]
        while waiting:  # depth first, the order of a BVH's joints; the root has no path to a cycle
            name, parent = waiting.pop()
            bones.append(self.built(name, parent))
            waiting += [(child, len(bones) - 1) for child in reversed(self.children.get(name, []))]
        lost = sorted(set(self.blocks) - {bone.name.lower() for bone in bones})
        if lost:
            raise self.fail(f"bone '{lost[0][:60]}' is not connected to the root", "Correct the :hierarchy section.")
        return AsfSkeleton(tuple(bones), _INCH_M / self.length, self.degrees, self.root_position)  # type: ignore[arg-type]

    def built(self, name: str, parent: int) -> AsfBone:
        if name == "root":
            axis = self.in_degrees(self.root_orientation)
            return AsfBone("root", parent, (0.0, 0.0, 0.0), axis, self.root_axis, self.root_order)
        block = self.blocks[name]
        x, y, z = (value * block.length for value in block.direction)
        return AsfBone(block.name, parent, (x, y, z), self.in_degrees(block.axis), block.axis_order, block.channels)

    def in_degrees(self, angles: tuple[float, ...]) -> tuple[float, float, float]:
        x, y, z = angles if self.degrees else (math.degrees(angle) for angle in angles)
        return x, y, z

    def numbers(self, words: list[str], count: int) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in words[1 : 1 + count])
        except ValueError:
            values = ()
        if len(values) != count or not all(math.isfinite(value) and abs(value) < 1e6 for value in values):
            raise self.fail(f"'{words[0]}' needs {count} numbers, found {words[1 : 1 + count]}"[:200])
        return values

    def order(self, words: list[str]) -> str:
        order = "".join(words).lower()
        if sorted(order) != ["x", "y", "z"]:
            raise self.fail(f"the axis order is '{order[:20]}' and must be XYZ in some order")
        return order

    def channels(self, words: list[str]) -> tuple[str, ...]:
        found = tuple(word.lower() for word in words[1:])
        if len(set(found)) != len(found) or not set(found) <= set(_CHANNELS):
            raise self.fail(f"'{words[0]}' lists {found}; allowed are {', '.join(_CHANNELS)}, each once"[:200])
        return found
