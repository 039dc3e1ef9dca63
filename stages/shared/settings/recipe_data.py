"""The archives of a recipe on this machine: which are there, and where those come from that are not."""

from __future__ import annotations

from pathlib import Path

from data_schemas.errors import InputError, UsageError
from stages.shared.catalogue.catalogue import DataSet, read_catalogue
from stages.shared.settings.recipes import DataNeeded, embedded_clips


def recipe_sources(recipe: str, data: DataNeeded, folder: Path) -> tuple[str, ...]:
    """What a recipe reads: its archives in `folder` and, where it says so, the clips that come with pumps.

    Raises: InputError naming the archives that are not there, with where each comes from.
    """
    there = archives_there(data, folder)
    missing = [name for name in data.archives if name not in there]
    if missing and (data.missing == "refused" or (not there and not data.embedded)):
        names = ", ".join(_archive(name) for name in missing)
        raise InputError(
            f"The recipe {recipe} reads recordings that are not in {folder}: {names}.",
            " ".join(
                ["Put them there, give another folder (SHARED_DATA=FOLDER) or other recordings (DATA='a.zip b/')."]
                + [_origin(name, folder) for name in missing]
            ),
        )
    alone = data.embedded == "alone" and not there
    return (*there.values(), *((embedded_clips(),) if alone or data.embedded == "beside" else ()))


def archives_there(data: DataNeeded, folder: Path) -> dict[str, str]:
    """The recipe's data sets that lie in the folder: name -> path of the archive."""
    found = {name: folder / _archive(name) for name in data.archives}
    return {name: str(path) for name, path in found.items() if path.is_file()}


def _archive(name: str) -> str:
    return _entry(name).archive_names[0]


def _entry(name: str) -> DataSet:
    catalogue = read_catalogue()
    if name not in catalogue or not catalogue[name].archive_names:
        raise UsageError(f"A recipe reads {name}, which is not an archive of the catalogue of data sets.")
    return catalogue[name]


def _origin(name: str, folder: Path) -> str:
    entry = _entry(name)
    if entry.files:
        return f"{_archive(name)}: run `pumps data fetch {name} -o {folder}`."
    return f"{_archive(name)} ({entry.home}): {entry.by_hand}"
