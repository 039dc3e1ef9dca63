"""The rule for outputs that exist, the same for every command.

An output that exists is replaced with `overwrite` only. A file or artefact that the command reads, or a part of one,
is never replaced, by whatever path it is named. A link is written through: the file that it leads to is replaced, and
the link stays. Pipes and character devices, such as `/dev/null`, are written to and never replaced; other things that
are not plain files are refused.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from data_schemas.artefact import refuse_foreign
from data_schemas.errors import PumpsError, UsageError
from data_schemas.manifest import DATA_PREFIX, MANIFEST_NAME
from data_schemas.whole_file import write_whole
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
        wrong = f"the suffix {path.suffix}, which this command does not write" if path.suffix else "no suffix"
        raise UsageError(f"{path.name} has {wrong}.", f"Name a file of {', '.join(suffixes)}.")
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

    Raises: UsageError if it exists and there is no `overwrite`, or if another field of the config names it, or names
        a folder with an artefact that it is a part of.
    """
    check_replaceable(path, config.overwrite, _paths_of(config, field))


def check_replaceable(path: Path, overwrite: bool, inputs: Iterable[tuple[str, Path]] = ()) -> None:
    """Check that `path` does not exist, or may be replaced, or is a pipe or character device.

    Args:
        inputs: what else the command was given, as (setting, path); none of it may be replaced.

    Raises: UsageError.
    """
    if not os.path.lexists(path):
        return
    for name, other in inputs:
        if _is_same(path, other):
            raise UsageError(
                f"{path} is given as {name.replace('_', '-')} too, and must not be replaced.",
                "Give another name for the output.",
            )
        if _is_inside(path, other):
            raise UsageError(
                f"{path} is a part of {other}, which is given as {name.replace('_', '-')}, and must not be replaced.",
                "Give another name for the output.",
            )
    if path.is_dir() or not _is_written_to(path):
        _refuse_odd(path)
        if not overwrite:
            raise UsageError(f"{path} exists.", "Give --overwrite to replace it, or another name.")


def write_output(path: Path, data: bytes) -> None:
    """Write an output file whole or not at all; through a link, and into a pipe or character device.

    Raises: UsageError for what is neither; PumpsError if it cannot be written.
    """
    if not os.path.lexists(path):
        write_whole(path, data)
        return
    _refuse_odd(path)
    if not _is_written_to(path):
        write_whole(path.resolve() if path.is_symlink() else path, data)
        return
    try:
        with open(path, "wb") as file:
            file.write(data)
    except OSError as error:
        raise PumpsError(f"{path} cannot be written: {error.strerror}.") from None


def paths_in(text: str) -> Iterator[Path]:
    """Every path that a setting's text may name: as it is, after "NAME=", and before "!MEMBER"."""
    after = text.partition("=")[2]
    found = [each[:at] for each in (text, after) for at in (None, *(i for i, a in enumerate(each) if a == "!"))]
    yield from map(Path, filter(None, dict.fromkeys(found)))


def _paths_of(config: WritingConfig, field: str) -> Iterator[tuple[str, Path]]:
    """Every path that the other fields may name."""
    for name in type(config).model_fields:
        value = getattr(config, name)
        for item in value if isinstance(value, tuple) else (value,):
            if name != field and isinstance(item, (str, Path)):
                for path in paths_in(str(item)):
                    yield name, path


def _is_same(one: Path, other: Path) -> bool:
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return False


def _is_inside(path: Path, folder: Path) -> bool:
    """Whether an existing file is a part of an artefact that `folder` is or holds."""
    try:
        if path.is_dir() or not folder.is_dir():
            return False
        place, within = path.resolve(), folder.resolve()
        return any(
            (parent == within or within in parent.parents)
            and place.relative_to(parent).parts[0].startswith((MANIFEST_NAME, DATA_PREFIX))
            and (parent / MANIFEST_NAME).is_file()
            for parent in place.parents
        )
    except (OSError, ValueError, RuntimeError):  # RuntimeError: a loop of links, before Python 3.13
        return False


def _is_written_to(path: Path) -> bool:
    """Whether bytes go into what is there and nothing is lost: a pipe or a character device, or a link to one."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)


def _refuse_odd(path: Path) -> None:
    """Raise UsageError for a link that leads nowhere, a disk and a socket."""
    try:
        mode = path.stat().st_mode
    except OSError:
        raise UsageError(
            f"{path} is a link that leads to no file.", "Remove the link, or give another name for the output."
        ) from None
    if stat.S_ISBLK(mode) or stat.S_ISSOCK(mode):
        raise UsageError(f"{path} is a disk or a socket, not a file.", "Give another name for the output.")
