"""Splitting clips into training, validation and test sets, always by whole clips."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from data_schemas.errors import InputError
from stages.shared.formats.sources import Source

SPLITS_NAME = "splits.json"
_STRICTEST = ("train", "val", "test")
_NOTES = (".json", ".txt")  # a file with such a suffix and a recording's name is usually about that recording
_TEST_SHARE, _VAL_SHARE = 10, 20  # one clip in this many, without a splits file


@dataclass
class Assigned:
    """Split of every source, by source name; licences from splits files, by data set; notes for the user."""

    splits: dict[str, str] = field(default_factory=dict)
    licences: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def assign_splits(sources: Sequence[Source], given: Path | None) -> Assigned:
    """Assign every source to a split.

    The splits file is the given one, else a `splits.json` beside the archives or in the folder of the recordings:
    {"archive.zip" or folder: {"test": [members], "val": [members]}}. All other members are for training; a data set
    may also have a "licence". A data set that is in no file is split by a hash of its members' names, so that the
    split does not depend on their order. Files of one name in several formats are assumed to be copies of one
    recording and get the same split.

    Raises: InputError if a splits file is damaged.
    """
    assigned = Assigned()
    by_set: dict[str, list[Source]] = {}
    for source in sources:
        by_set.setdefault(source.data_set, []).append(source)
    for data_set, members in by_set.items():
        path = given or _beside(members[0])
        named = _read_splits(path).get(data_set) if path else None
        if named is None:
            assigned.splits |= _by_hash(members)
            if len(members) >= 3:
                assigned.notes.append(f"{data_set} is not in a splits file: one clip in {_TEST_SHARE} is for tests.")
            continue
        found, missing = _by_file(members, named)
        assigned.splits |= found
        if isinstance(named.get("licence"), str):
            assigned.licences[data_set] = named["licence"]
        if missing:
            assigned.notes.append(
                f"{path} names {len(missing)} clips of {data_set} that do not exist, first '{missing[0]}'."
            )
    for data_set, members in by_set.items():
        copies = _copies(members)
        for names in copies:
            split = max((assigned.splits[name] for name in names), key=_STRICTEST.index)
            assigned.splits |= dict.fromkeys(names, split)
        if copies:
            first = " and ".join(PurePosixPath(name).name for name in copies[0])
            assigned.notes.append(
                f"{len(copies)} recordings of {data_set} seem to exist in several formats, first {first};"
                " all are read."
            )
    return assigned


def _beside(source: Source) -> Path | None:
    folder = Path(source.archive or source.name).parent
    path = folder / SPLITS_NAME
    return path if path.is_file() else None


def _read_splits(path: Path) -> dict[str, dict[str, Any]]:
    try:
        raw = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.", "Check --splits.") from None
    except (ValueError, RecursionError):
        raise InputError(f"{path} is not JSON.", "Check --splits.") from None
    hint = 'It must hold {"archive.zip": {"test": [...], "val": [...]}}.'
    if not isinstance(raw, dict):
        raise InputError(f"{path} is not a splits file.", hint)
    for data_set, named in raw.items():
        lists = [named.get(split, []) for split in ("test", "val")] if isinstance(named, dict) else [None]
        if not all(isinstance(names, list) and all(isinstance(name, str) for name in names) for names in lists):
            raise InputError(f"{path}: the splits of '{data_set}' must be lists of names.", hint)
    return raw


def _by_file(members: Sequence[Source], named: dict[str, Any]) -> tuple[dict[str, str], list[str]]:
    wanted = {name: split for split in ("val", "test") for name in named.get(split, [])}
    splits = {}
    used = set()
    for source in members:
        split = wanted.get(source.member)
        splits[source.name] = split or "train"
        if split:
            used.add(source.member)
    return splits, sorted(set(wanted) - used)


def _copies(members: Sequence[Source]) -> list[list[str]]:
    """Sources' names of recordings that are there in several formats, each format once."""
    by_stem: dict[str, list[Source]] = {}
    for source in members:
        if source.suffix in _NOTES:
            continue
        by_stem.setdefault(PurePosixPath(source.member).stem.lower(), []).append(source)
    return [
        [source.name for source in found]
        for found in by_stem.values()
        if len(found) > 1 and len({source.suffix for source in found}) == len(found)
    ]


def _by_hash(members: Sequence[Source]) -> dict[str, str]:
    ordered = sorted(members, key=lambda source: hashlib.sha256(source.member.encode()).hexdigest())
    tests = max(1, len(ordered) // _TEST_SHARE) if len(ordered) >= 3 else 0
    vals = max(1, len(ordered) // _VAL_SHARE) if len(ordered) >= 3 else 0
    names = ["test"] * tests + ["val"] * vals + ["train"] * len(ordered)
    return {source.name: split for source, split in zip(ordered, names, strict=False)}
