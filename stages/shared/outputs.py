"""The rule for outputs that exist, the same for every command.

An output that exists is replaced with `overwrite` only. A file or artefact that the command reads is never replaced.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from data_schemas.artefact import refuse_foreign
from data_schemas.errors import UsageError
from data_schemas.manifest import MANIFEST_NAME
from stages.shared.contract import WritingConfig


def check_file(config: WritingConfig, suffixes: Collection[str] = (), field: str = "output") -> None:
    """Check that a file may be written.

    Args:
        suffixes: those that the command can write, lower case, with their dots; none to allow all.
        field:    the config's field that names the file.

    Raises: UsageError if the file exists and may not be replaced, is a folder or an input, or has another suffix.
    """
    path = Path(getattr(config, field))
    if path.is_dir():
        raise UsageError(f"{path} is a folder.", "Name the file to write.")
    if suffixes and path.suffix.lower() not in suffixes:
        named = f"the suffix {path.suffix}" if path.suffix else "no suffix"
        raise UsageError(
            f"{path.name} has {named}, which this command does not write.", f"Name a file of {', '.join(suffixes)}."
        )
    check_written(config, path, field)


def check_artefact(config: WritingConfig, kind: str, field: str = "output") -> None:
    """Check that an artefact of this kind may be written.

    Raises: UsageError if an artefact exists there and may not be replaced, or the place holds something else.
    """
    path = Path(getattr(config, field))
    if path.exists() and not path.is_dir():
        raise UsageError(f"{path} is a file; an artefact is a folder.", "Give another name for the output.")
    if os.path.lexists(path / MANIFEST_NAME):
        check_written(config, path, field)
        refuse_foreign(path, kind)


def check_folder(config: WritingConfig, field: str = "output") -> None:
    """Check that several files may be written into a folder: it is empty, or they may replace those in it.

    Raises: UsageError.
    """
    path = Path(getattr(config, field))
    if path.exists() and not path.is_dir():
        raise UsageError(f"{path} is a file, and a folder is written.", "Give another name for the output.")
    if path.is_dir() and any(not entry.name.startswith(".") for entry in path.iterdir()):
        check_written(config, path, field)


def check_written(config: WritingConfig, path: Path, field: str = "output") -> None:
    """Check that `path`, which the config's `field` leads to, may be written.

    Raises: UsageError if it exists and there is no `overwrite`, or if another field of the config names it.
    """
    check_replaceable(path, config.overwrite, _paths_of(config, field))


def check_replaceable(path: Path, overwrite: bool, others: Iterable[tuple[str, Path]] = ()) -> None:
    """Check that `path` does not exist, or may be replaced.

    Args:
        others: what else the command was given, as (setting, path); none of it may be replaced.

    Raises: UsageError.
    """
    if not os.path.lexists(path):
        return
    for name, other in others:
        if _is_same(path, other):
            raise UsageError(
                f"{path} is given as {name.replace('_', '-')} too, and must not be replaced.",
                "Give another name for the output.",
            )
    if not overwrite:
        raise UsageError(f"{path} exists.", "Give --overwrite to replace it, or another name.")


def _paths_of(config: WritingConfig, field: str) -> Iterator[tuple[str, Path]]:
    """Every text of the other fields that may be a path: as it is, after "NAME=", and before "!MEMBER"."""
    for name in type(config).model_fields:
        value = getattr(config, name)
        for item in value if isinstance(value, tuple) else (value,):
            if name != field and isinstance(item, (str, Path)):
                whole = str(item)
                for text in dict.fromkeys((whole, whole.partition("=")[2], whole.partition("!")[0])):
                    if text:
                        yield name, Path(text)


def _is_same(one: Path, other: Path) -> bool:
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return False
