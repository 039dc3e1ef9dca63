"""An archive of weights, unpacked into a folder that it cannot leave and whose size is bounded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from data_schemas.disk import check_room, write_flushed
from data_schemas.errors import InputError
from stages.shared.file_names import folded, is_file_name
from stages.shared.formats.archives import Member, forget, members_of, read_member

_SUFFIXES = (".json", ".md", ".parquet", ".safetensors")
_MOST_FILES = 1000
_MOST_BYTES = 4 << 30
_MANIFESTS = ("manifest.json", "ae/manifest.json", "train-ae/manifest.json")


def unpack(archive: Path, folder: Path) -> None:
    """Write the weights of an archive into a folder that exists. Links, other special members and hidden files are
    left out.

    Raises: InputError if a name leads out of the folder, is not one that every system takes, comes twice, or is a
        file's and a folder's, if a file is of a kind that weights do not have, if the archive is too large, or if it
        holds no weights; nothing is written then. InputError also if the archive is damaged. OSError if the disk
        refuses.
    """
    try:
        members = members_of(str(archive))
        inside = _inside(archive, members)
        _check(archive, inside)
        check_room(folder, sum(member.size for member in inside.values()))
        for path, member in inside.items():
            target = folder.joinpath(*path.parts)
            target.parent.mkdir(parents=True, exist_ok=True)
            write_flushed(target, read_member(str(archive), member))
    finally:
        forget()  # Windows removes no open file


def _inside(archive: Path, members: Sequence[Member]) -> dict[PurePosixPath, Member]:
    """The members below the folder of the weights, by their paths in it. An archive may have folders above it."""
    names = [PurePosixPath(member.name) for member in members]
    roots = sorted(
        {
            PurePosixPath(*name.parts[: len(name.parts) - len(PurePosixPath(manifest).parts)])
            for name in names
            for manifest in _MANIFESTS
            if name.as_posix() == manifest or name.as_posix().endswith(f"/{manifest}")
        },
        key=lambda root: len(root.parts),
    )
    if not roots:
        raise InputError(
            f"{archive.name} holds no weights: neither ae and lms, nor a checkpoint.",
            "Make the archive of the folder that `pumps weights pack` wrote.",
        )
    found: dict[PurePosixPath, Member] = {}
    for name, member in zip(names, members, strict=True):
        hidden = any(part.startswith(".") for part in name.parts)
        if not hidden and name.is_relative_to(roots[0]):
            path = name.relative_to(roots[0])
            if path in found:
                raise InputError(f"{archive.name} holds {member.name!r} twice.", "Make the archive again.")
            found[path] = member
    return found


def _check(archive: Path, inside: dict[PurePosixPath, Member]) -> None:
    size = sum(member.size for member in inside.values())
    if len(inside) > _MOST_FILES or size > _MOST_BYTES:
        raise InputError(
            f"{archive.name} holds {len(inside)} files of {size / 1e6:.0f} MB, more than weights may have "
            f"({_MOST_FILES} files, {_MOST_BYTES / 1e6:.0f} MB).",
            "Check that it is an archive of weights.",
        )
    files: dict[str, str] = {}
    for path in inside:
        name = path.as_posix()
        if not all(map(is_file_name, path.parts)):
            raise InputError(
                f"{archive.name} holds {name!r}, a name that not every system takes.", "Rename the file."
            )
        if path.suffix not in _SUFFIXES:
            raise InputError(
                f"{archive.name} holds {name!r}, and weights have only {', '.join(_SUFFIXES)}.", "Leave the file out."
            )
        if files.setdefault(folded(name), name) != name:
            raise InputError(
                f"{archive.name} holds {name!r} and {files[folded(name)]!r}, which are one file on some systems.",
                "Rename one of them.",
            )
    for path in inside:
        for above in path.parents:
            if (file := files.get(folded(above.as_posix()))) is not None:
                raise InputError(
                    f"{archive.name} holds the file {file!r}, and {path.as_posix()!r} in a folder of that name.",
                    "Rename one of them.",
                )
