"""Skeleton maps: TOML files in which the user states the body part of each joint. Read, checked, written.

unit_m = 0.01                      # metres in one unit of the file; leave out to have it found
up = "y"                           # or "z"; leave out to have it found
pelvis = "Hips"                    # topmost joint of the body; leave out for the joint where the chains meet
outside = ["Sword"]                # not part of the body, with all joints below them
[chains]                           # from the first joint to the last; points are drawn along them
spine = ["Hips", "Spine", "Head"]  # joints between two named ones are filled in
left_arm = [...]                   # and right_arm, left_leg, right_leg
[beside]                           # joints off the chains whose group differs from their parent's
left_leg = ["Holster"]
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, NO_GROUP
from stages.shared.humanoid.anatomy import RigAnatomy
from stages.shared.humanoid.body_groups import BodyParts
from stages.shared.toml import read_toml, toml_text

_MOST_SHOWN = 20  # faults in an error; a suggestion for each takes time that grows with the length of both names
_LONGEST_SHOWN = 60
_KEYS = ("unit_m", "up", "pelvis", "outside", "chains", "beside")
UP_AXES = ("y", "z")


@dataclass(frozen=True)
class SkeletonMap:
    """The content of a map, joints by name; None or empty for keys that it leaves out.

    chains, beside: a tuple of names for each of BODY_GROUPS. faults: faults of the map itself, one clause each; they
    are reported together with those found against a rig.
    """

    name: str
    chains: tuple[tuple[str, ...], ...] = ((),) * 5
    beside: tuple[tuple[str, ...], ...] = ((),) * 5
    pelvis: str | None = None
    outside: tuple[str, ...] = ()
    unit_m: float | None = None
    up_axis: str | None = None
    faults: tuple[str, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints that the map names, each once."""
        named = [joint for chain in (*self.chains, *self.beside, self.outside) for joint in chain]
        return tuple(dict.fromkeys([*named, *([self.pelvis] if self.pelvis else [])]))


def read_skeleton_map(path: Path) -> SkeletonMap:
    """The map in a file. `choose_map` reports its faults. Raises InputError if the file is missing or not TOML."""
    return map_of_values(read_toml(path, what="skeleton map", option="--skeleton-map"), str(path))


def read_skeleton_maps(paths: Sequence[Path]) -> tuple[SkeletonMap, ...]:
    """Maps for several rigs. Raises InputError for the first map that has a fault of its own."""
    maps = tuple(read_skeleton_map(path) for path in paths)
    for each in maps:
        if each.faults:
            raise _error(each, each.faults)
    return maps


def unused_maps(maps: Sequence[SkeletonMap], rigs: Iterable[Sequence[str]]) -> list[str]:
    """One sentence for each map that matches none of the rigs; a rig is given by its joints' names."""
    taken = {chosen.name for names in rigs if (chosen := choose_map(maps, names)) is not None}
    return [f"{each.name} matches none of the rigs that were read." for each in maps if each.name not in taken]


def map_of_values(values: dict[str, Any], name: str) -> SkeletonMap:
    """The map of values read from TOML; `name` is its name in error messages."""
    faults = [f"'{key}' is not a key; there are {', '.join(_KEYS)}" for key in values if key not in _KEYS]
    chains = _groups(values.get("chains", {}), "chains", faults)
    beside = _groups(values.get("beside", {}), "beside", faults)
    faults += [f"chains.{group} is missing" for group, chain in zip(BODY_GROUPS, chains, strict=True) if not chain]
    unit, up, pelvis = values.get("unit_m"), values.get("up"), values.get("pelvis")
    if unit is not None and not (isinstance(unit, (int, float)) and not isinstance(unit, bool) and 0 < unit < 1e6):
        faults.append(f"unit_m is {unit!r} and must be metres above 0")
        unit = None
    if up is not None and up not in UP_AXES:
        faults.append(f"up is {up!r} and must be {' or '.join(UP_AXES)}")
        up = None
    if pelvis is not None and not isinstance(pelvis, str):
        faults.append("pelvis must be a joint's name")
        pelvis = None
    outside = _names(values.get("outside", []), "outside", faults)
    unit = float(unit) if unit is not None and math.isfinite(unit) else None
    return SkeletonMap(name, chains, beside, pelvis, outside, unit, up, tuple(faults))


def choose_map(maps: Sequence[SkeletonMap], names: Sequence[str], *, must_fit: bool = False) -> SkeletonMap | None:
    """The first map whose joints are all on the rig; None if no map names any of the rig's joints.

    Raises: InputError listing all faults, if a map is faulty, if only some of the joints it names are on the rig, or
        if `must_fit` is True and some joint that it names is not on the rig.
    """
    known = set(names)
    for each in maps:
        unknown = [joint for joint in each.joints if joint not in known]
        foreign = len(unknown) == len(each.joints)
        if each.faults or (unknown and (must_fit or not foreign)):
            missing = [_unknown(joint, names) for joint in unknown[:_MOST_SHOWN]]
            if len(unknown) > _MOST_SHOWN:
                missing.append(f"the rig lacks {len(unknown) - _MOST_SHOWN} more of its joints")
            raise _error(each, [*each.faults, *missing])
        if not unknown:
            return each
    return None


def parts_of_map(given: SkeletonMap, names: Sequence[str], parents: np.ndarray) -> BodyParts:
    """The body parts of a rig by a map.

    Raises: InputError listing all faults, if a chain does not run down the rig.
    """
    index = {name: joint for joint, name in enumerate(names)}
    lines = [_line(joint, parents) for joint in range(len(names))]
    faults: list[str] = []
    chains = tuple(
        _filled(group, [index[name] for name in chain], lines, names, faults)
        for group, chain in zip(BODY_GROUPS, given.chains, strict=True)
    )
    taken: dict[int, str] = {}
    for group, chain in zip(BODY_GROUPS, chains, strict=True):
        for joint in chain:
            if joint in taken:
                faults.append(f"'{names[joint]}' is on the chains of {taken[joint]} and of {group}")
            taken[joint] = group
    firsts = [chain[0] for chain in chains if chain]
    pelvis = index[given.pelvis] if given.pelvis else max(set.intersection(*(set(lines[j]) for j in firsts)))
    for group, chain in zip(BODY_GROUPS, chains, strict=True):
        if chain and pelvis not in lines[chain[0]]:
            faults.append(f"{group} begins at '{names[chain[0]]}', which is not below '{names[pelvis]}'")
    if faults:
        raise _error(given, faults)
    grouped = {joint: group for group, chain in enumerate(chains) for joint in chain}
    grouped |= {index[name]: group for group, found in enumerate(given.beside) for name in found}
    grouped |= {index[name]: NO_GROUP for name in given.outside}
    groups = np.full(len(names), NO_GROUP, np.int8)
    for joint in range(len(names)):
        if joint == pelvis:
            groups[joint] = 0
        elif pelvis in lines[joint]:
            groups[joint] = grouped.get(joint, int(groups[parents[joint]]))
    return BodyParts(groups, pelvis, chains, sided=True)


def text_of_anatomy(anatomy: RigAnatomy, names: Sequence[str], parents: np.ndarray, source: str) -> str:
    """The map of a rig as pumps found it, as TOML text to edit."""
    grouped = {joint: group for group, chain in enumerate(anatomy.chains) for joint in chain}
    beside: dict[str, list[str]] = {}
    outside: list[str] = []
    above = set(_line(anatomy.pelvis, parents)[1:])
    for joint, name in enumerate(names):
        group, parent = int(anatomy.groups[joint]), int(parents[joint])
        if joint in grouped or joint == anatomy.pelvis:
            continue
        if group == NO_GROUP:
            if joint not in above and parent >= 0 and anatomy.groups[parent] != NO_GROUP:
                outside.append(name)
        elif group != anatomy.groups[parent]:
            beside.setdefault(BODY_GROUPS[group], []).append(name)
    values: dict[str, Any] = {"unit_m": anatomy.unit_m, "up": anatomy.up_axis, "pelvis": names[anatomy.pelvis]}
    values["outside"] = outside
    values["chains"] = {g: [names[j] for j in c] for g, c in zip(BODY_GROUPS, anatomy.chains, strict=True)}
    if beside:
        values["beside"] = beside
    found = anatomy.findings
    head = [
        f"# Body parts that pumps found on {' '.join(source.split())}. Edit them; give the file as --skeleton-map.",
        f"# Body groups were found by {found['groups'].how} (sure: {found['groups'].sure:.2f}), left and right by"
        f" {found['sides'].how} (sure: {found['sides'].sure:.2f}).",
        "# Points are drawn along the chains, from the first joint to the last. Joints off a chain belong to the",
        "# group of the joint above them; no points are drawn on them, and their motion is copied or interpolated.",
        "",
    ]
    return "\n".join(head) + toml_text(values)


def _groups(given: Any, table: str, faults: list[str]) -> tuple[tuple[str, ...], ...]:
    if not isinstance(given, dict):
        faults.append(f"{table} must be a table of groups")
        given = {}
    faults += [
        f"{table}.{key} is not a body group; there are {', '.join(BODY_GROUPS)}"
        for key in given
        if key not in BODY_GROUPS
    ]
    return tuple(_names(given.get(group, []), f"{table}.{group}", faults) for group in BODY_GROUPS)


def _names(given: Any, key: str, faults: list[str]) -> tuple[str, ...]:
    if not isinstance(given, list) or not all(isinstance(name, str) for name in given):
        faults.append(f"{key} must be a list of joints' names")
        return ()
    return tuple(given)


def _unknown(joint: str, names: Sequence[str]) -> str:
    shown = joint[:_LONGEST_SHOWN]
    near = difflib.get_close_matches(shown, [name[:_LONGEST_SHOWN] for name in names[:500]], n=1)
    return f"the rig has no joint '{shown}'" + (f"; is it '{near[0]}'?" if near else "")


def _line(joint: int, parents: np.ndarray) -> list[int]:
    line = [joint]
    while parents[line[-1]] >= 0:
        line.append(int(parents[line[-1]]))
    return line


def _filled(
    group: str, chain: list[int], lines: list[list[int]], names: Sequence[str], faults: list[str]
) -> tuple[int, ...]:
    """The chain, including the joints between the named ones."""
    filled = chain[:1]
    for before, joint in pairwise(chain):
        line = lines[joint]
        if before not in line[1:]:
            faults.append(f"in {group} '{names[joint]}' is not below '{names[before]}'")
            continue
        filled += reversed(line[: line.index(before)])
    return tuple(filled)


def _error(given: SkeletonMap, faults: Sequence[str]) -> InputError:
    if len(faults) == 1:
        return InputError(f"{given.name}: {faults[0]}.", "`pumps inspect FILE --map` prints a map that fits.")
    listed = "".join(f"\n  {fault}" for fault in faults)
    return InputError(
        f"{given.name} has {len(faults)} faults:{listed}", "`pumps inspect FILE --map` prints a map that fits."
    )
