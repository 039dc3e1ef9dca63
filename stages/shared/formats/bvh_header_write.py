"""Writing the HIERARCHY text of a BVH for joints read from another format, so that any motion can be saved as BVH."""

from __future__ import annotations

import re
from collections.abc import Sequence

_TURNS = "Zrotation Xrotation Yrotation"
_PLACES = "Xposition Yposition Zposition"
_DEEPEST_INDENT = 32  # deeper joints are not indented further: a chain of thousands would be mostly blanks
_UNFIT = re.compile(r"[\x00-\x20\x7f-\x9f{}\u2028\u2029]+")


def plain_names(names: Sequence[str]) -> tuple[str, ...]:
    """Joint names that are valid in a BVH: without blanks, braces and control characters, not empty, unique."""
    taken: set[str] = set()
    out = []
    for index, name in enumerate(names):
        base = _UNFIT.sub("_", name.strip())[:200] or f"joint_{index}"
        unique, copy = base, 1
        while unique in taken:
            copy += 1
            unique = f"{base}_{copy}"
        taken.add(unique)
        out.append(unique)
    return tuple(out)


def header_text(
    names: Sequence[str],
    parents: Sequence[int],
    offsets: Sequence[Sequence[float]],
    end_sites: Sequence[Sequence[float]],
    placed: Sequence[bool],
    decimals: int = 6,
) -> str:
    """The text of a BVH up to its MOTION line.

    Args:
        parents: joints in depth-first order, the order of a BVH; -1 for joint 0.
        end_sites: (J, 3) ends of leaves; a leaf with zeros gets an End Site of zero length.
        placed: joints that get position channels before their rotation channels.
    """
    children: list[list[int]] = [[] for _ in names]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(joint)
    lines = ["HIERARCHY"]
    to_do: list[tuple[int, int]] = [(0, 0)]  # joint, or -1 for a closing brace, and depth
    while to_do:
        joint, depth = to_do.pop()
        pad = "  " * min(depth, _DEEPEST_INDENT)
        if joint < 0:
            lines.append(f"{pad}}}")
            continue
        inner = f"{pad}  "
        lines += [f"{pad}{'JOINT' if depth else 'ROOT'} {names[joint]}", f"{pad}{{"]
        lines.append(f"{inner}OFFSET {_place(offsets[joint], decimals)}")
        lines.append(f"{inner}CHANNELS {f'6 {_PLACES}' if placed[joint] else '3'} {_TURNS}")
        if not children[joint]:
            end = _place(end_sites[joint], decimals)
            lines += [f"{inner}End Site", f"{inner}{{", f"{inner}  OFFSET {end}", f"{inner}}}"]
        to_do.append((-1, depth))
        to_do += [(child, depth + 1) for child in reversed(children[joint])]
    return "\n".join(lines) + "\n"


def _place(offset: Sequence[float], decimals: int) -> str:
    return " ".join(f"{value + 0.0:.{decimals}f}" for value in offset)
