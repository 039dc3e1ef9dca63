"""Splitting clips into training, validation and test sets, always by whole clips."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from data_schemas.errors import InputError
from stages.shared.formats.archives import archive_suffix
from stages.shared.formats.sources import Source

SPLITS_NAME = "splits.json"
_STRICTEST = ("train", "val", "test")
_NOTES = (".json", ".txt")  # a file with such a suffix and a recording's name is usually about that recording
_HINT = 'It must hold {"archive.zip": {"test": [...], "val": [...]}}; with --splits, {"train": [...]} too.'
_SPLIT_NAMES = {"train": "train", "val": "val", "vald": "val", "valid": "val", "validation": "val", "test": "test"}
# AMASS' data sets whose names differ between its releases, lower case: old -> new.
_RENAMED = {
    "biomotionlab_ntroje": "bmlrub", "dfaust_67": "dfaust", "dfaust67": "dfaust",
    "eyes_japan_dataset": "eyesjapandataset",
    "mpi_hdm05": "hdm05", "mpi_limits": "poseprior", "mpi_mosh": "mosh", "ssm_synced": "ssm",
    "tcd_handmocap": "tcdhands", "transitions_mocap": "transitions",
}  # fmt: skip
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

    A file {"train": [...], "val" or "vald": [...], "test": [...]}, as papers on AMASS have them, names data sets
    (folders or archives, under AMASS' old or new names) and members; sources that it does not name get no split.

    Raises: InputError if a splits file is damaged.
    """
    assigned = Assigned()
    by_split = _read_by_split(given) if given else None
    if by_split is not None:
        return _by_split(sources, by_split, str(given))
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


def _read_by_split(path: Path) -> dict[str, str] | None:
    """Name -> split of a file whose top level is splits; None for a file of data sets."""
    raw = _json_of(path)
    if not isinstance(raw, dict) or not raw or not set(raw) <= set(_SPLIT_NAMES):
        return None
    if all(isinstance(named, dict) for named in raw.values()):  # folders of recordings that are called train, ...
        return None
    named: dict[str, str] = {}
    for word, names in raw.items():
        if not isinstance(names, list) or not all(isinstance(name, str) and name for name in names):
            raise InputError(f"{path}: the split '{word}' must be a list of names.", _HINT)
        for name in names:
            split = _SPLIT_NAMES[word]
            if named.setdefault(_plain(name), split) != split:
                raise InputError(f"{path} has '{name}' in two splits.", "Name it once.")
    return named


def _by_split(sources: Sequence[Source], named: dict[str, str], path: str) -> Assigned:
    """The splits of sources that a file names, a member before its folders, an inner folder before an outer one."""
    assigned, used = Assigned(), set()
    for source in sources:
        data_set = source.data_set.removesuffix(archive_suffix(source.data_set))
        parts = [data_set, *PurePosixPath(source.member.replace("\\", "/")).parts]
        ends = ["/".join(parts[start:]) for start in range(len(parts))]
        found = next((name for name in map(_plain, [*ends, *parts[-2::-1]]) if name in named), None)
        if found is not None:
            assigned.splits[source.name] = named[found]
            used.add(found)
    left, unused = len(sources) - len(assigned.splits), sorted(set(named) - used)
    if left:
        assigned.notes.append(f"{left} of {len(sources)} files are in no split of {path} and are left out.")
    if unused:
        assigned.notes.append(
            f"{path} names {len(unused)} data sets or files that are not there, first '{unused[0]}'."
        )
    return assigned


def _plain(name: str) -> str:
    """A name without the ends that releases of AMASS differ in: suffix, "_poses"; data sets by their new names."""
    plain = name.lower().removesuffix(".npz").removesuffix("_poses").removesuffix("_stageii")
    return "/".join(_RENAMED.get(part, part) for part in plain.split("/"))


def _beside(source: Source) -> Path | None:
    folder = Path(source.archive or source.name).parent
    path = folder / SPLITS_NAME
    return path if path.is_file() else None


def _json_of(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.", "Check --splits.") from None
    except (ValueError, RecursionError):
        raise InputError(f"{path} is not JSON.", "Check --splits.") from None


def _read_splits(path: Path) -> dict[str, dict[str, Any]]:
    raw = _json_of(path)
    if not isinstance(raw, dict):
        raise InputError(f"{path} is not a splits file.", _HINT)
    for data_set, named in raw.items():
        lists = [named.get(split, []) for split in ("test", "val")] if isinstance(named, dict) else [None]
        if not all(isinstance(names, list) and all(isinstance(name, str) for name in names) for names in lists):
            raise InputError(f"{path}: the splits of '{data_set}' must be lists of names.", _HINT)
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
