"""The catalogue of public data sets, read from a TOML file: that of pumps (`data_sets.toml`), or the user's."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from data_schemas.errors import InputError, UsageError
from stages.shared.file_names import is_file_name
from stages.shared.toml import TOMLDecodeError, toml_values

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
SHA256 = re.compile(r"sha256:[0-9a-f]{64}")
_CHECKSUM = re.compile(rf"{SHA256.pattern}|md5:[0-9a-f]{{32}}|")


class Strict(BaseModel):
    """Base of the entries of a catalogue: frozen, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


_Entry = TypeVar("_Entry", bound=Strict)


class DataFile(Strict):
    """One file to download.

    name:     its plain file name on the disk.
    url:      http or https.
    bytes:    its size; 0 if it is not published.
    checksum: "sha256:..." or "md5:..."; "" if none is published.
    checksum_from: the publisher of the checksum.
    """

    name: str
    url: str
    bytes: int = Field(0, ge=0)
    checksum: str = ""
    checksum_from: str = ""

    @field_validator("name")
    @classmethod
    def _plain(cls, name: str) -> str:
        if not NAME.fullmatch(name) or not is_file_name(name) or name.endswith((".part", ".part.mark")):
            raise ValueError("must be a plain file name that does not end in .part or .part.mark")
        return name

    @field_validator("url")
    @classmethod
    def _web(cls, url: str) -> str:
        if not url.startswith(("http://", "https://")):
            raise ValueError("must start with http:// or https://")
        return url

    @field_validator("checksum")
    @classmethod
    def _known(cls, checksum: str) -> str:
        if not _CHECKSUM.fullmatch(checksum):
            raise ValueError("must be sha256:<64 hex digits> or md5:<32 hex digits>")
        return checksum


class DataSet(Strict):
    """One data set.

    by_hand: instructions for a download that a person must do (an account is needed, or the host changes); then
             there are no files.
    ingest:  the command that ingests the file, with {file} in its place.
    archives: names of archives that hold its recordings, besides the files that are downloaded.
    rig:      the rig of recordings that hold none: "archive.zip!member", an archive beside theirs.
    true_fps: pattern of member names -> true frames a second, where the recordings state a wrong rate.
    """

    title: str
    format: str
    home: str
    licence: str
    licence_url: str
    terms: str
    ingest: str
    files: tuple[DataFile, ...] = ()
    by_hand: str = ""
    archives: tuple[str, ...] = ()
    rig: str = ""
    true_fps: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _reachable(self) -> DataSet:
        if bool(self.files) == bool(self.by_hand):
            raise ValueError("needs either files, or by_hand with instructions for a person")
        if len({each.name.lower() for each in self.files}) < len(self.files):
            raise ValueError("gives two files the same name")
        return self

    @property
    def archive_names(self) -> tuple[str, ...]:
        """File names of the archives that hold its recordings."""
        return (*self.archives, *(each.name for each in self.files))

    @property
    def bytes(self) -> int:
        """Size of all files; 0 if the size of one is unknown."""
        sizes = [each.bytes for each in self.files]
        return sum(sizes) if all(sizes) else 0


def read_catalogue(path: Path | None = None) -> dict[str, DataSet]:
    """The data sets by name, in the file's order.

    Args:
        path: a TOML file with the layout of `data_sets.toml`; None for that of pumps.

    Raises: InputError listing every fault of the file.
    """
    where = str(path) if path else "data_sets.toml"
    try:
        data = path.read_bytes() if path else files("stages.shared.catalogue").joinpath("data_sets.toml").read_bytes()
    except OSError as error:
        raise InputError(f"{where} cannot be read: {error.strerror}.") from error
    return entries_of(where, data, DataSet, "catalogue")


def entries_of(where: str, data: bytes, kind: type[_Entry], what: str) -> dict[str, _Entry]:
    """The tables of a TOML file by name, in the file's order, each an entry of this kind.

    Args:
        where: the file, for errors. what: what the file should be, for errors.

    Raises: InputError listing every fault of the file.
    """
    try:
        tables = toml_values(data.decode("utf-8"))
    except (UnicodeDecodeError, TOMLDecodeError) as error:
        raise InputError(f"{where} is not a TOML file: {error}.") from error
    found: dict[str, _Entry] = {}
    faults: list[str] = []
    for name, table in tables.items():
        try:
            if not NAME.fullmatch(name):
                faults.append(f"the name {name!r} is not a plain word")
            found[name] = kind.model_validate(table)
        except ValidationError as error:  # noqa: PERF203
            faults += [f"{name}.{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors()]
    if faults:
        raise InputError(f"{where} is not a {what}: {'; '.join(faults)}.")
    return found


@cache
def data_sets_by_archive() -> dict[str, tuple[str, DataSet]]:
    """File name of an archive -> name and entry of the data set that it holds, from the catalogue of pumps."""
    return {archive: (name, each) for name, each in read_catalogue().items() for archive in each.archive_names}


def data_set_named(catalogue: dict[str, DataSet], name: str) -> DataSet:
    """The data set with this name. Raises UsageError listing the known names."""
    if name not in catalogue:
        raise UsageError(f"No data set is called {name!r}.", f"There are {', '.join(catalogue)}.")
    return catalogue[name]
