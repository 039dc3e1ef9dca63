"""`pumps weights fetch`: weights from a registry or an address, downloaded, checked and kept under their name."""

from __future__ import annotations

import json
import os
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

from pydantic import ValidationError

from data_schemas.damaged_files import reading
from data_schemas.disk import cannot_be_written, missing_above, remove_empty, write_flushed
from data_schemas.errors import InputError, UsageError
from data_schemas.own_folders import is_own_folder, make_own_folder, refuse_unmarked, remove_own_folder
from data_schemas.write_lock import write_lock
from stages.shared.catalogue.acceptance import acceptance_file, require_acceptance
from stages.shared.catalogue.catalogue import NAME, DataFile
from stages.shared.catalogue.download import fetch_file
from stages.shared.catalogue.weights_registry import (
    MOST_BYTES,
    RegisteredWeights,
    checked_sha256,
    is_address,
    read_registry,
)
from stages.shared.contract import StageReport
from stages.shared.formats.archives import ARCHIVE_SUFFIXES, archive_suffix
from stages.shared.progress import SILENT, Progress
from stages.shared.weights.facts import known_facts
from stages.shared.weights.fetched import fetched_folder
from stages.shared.weights.shipped import shipped_weights
from stages.shared.weights.task_weights import shipped_task_weights
from stages.weights.fetch.config import Config
from stages.weights.fetch.unpacking import unpack

SOURCE_NAME = "fetched.json"  # address and checksum of the archive that a folder of weights came from


class _Licence(NamedTuple):
    """What an archive's own manifests state."""

    licence: str
    licence_url: str = ""
    terms: str = "The weights carry the licences of the data that they were trained on."


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Download what is missing, unpack it beside its place, check it, and give it its name when all is there.

    Raises: UsageError for an unknown name, a licence that is not accepted, an address without a checksum, or weights
        that are there already and may not be replaced; InputError for a registry or an archive that is not right;
        PumpsError if the download fails (what is downloaded is kept, and the next call goes on from there).
    """
    name, file, entry = _wanted(config)
    home = config.output or fetched_folder()
    target = home / name
    if _source_of(target).get("checksum") == file.checksum:
        return _report(target, _facts(target), config, "is there already")
    _check_place(target, config.overwrite)
    acceptances = config.acceptances or acceptance_file()
    if entry:
        require_acceptance(f"weights/{name}", entry, config.accept_licence, acceptances)
    downloads, staging = home / ".downloads", home / f".{name}.unpacking"
    may_be_empty = [downloads, *missing_above(target)]
    try:
        downloads.mkdir(parents=True, exist_ok=True)
        with write_lock(downloads):
            try:  # inside the lock, since another fetch may be filling the folder
                archive = fetch_file(file, downloads, progress=progress, overwrite=True, most_bytes=MOST_BYTES)
                facts = _unpacked(archive, staging, file, entry)
                if not entry:
                    licence = _Licence("; ".join(facts["licences"]) or "none stated")
                    require_acceptance(f"weights/{name}", licence, config.accept_licence, acceptances)
                remove_own_folder(target)
                os.replace(staging, target)
                archive.unlink()
            finally:
                remove_own_folder(staging)
    except OSError as error:
        raise cannot_be_written(target, error) from error
    finally:
        remove_empty(may_be_empty)
    return _report(target, facts, config, "is fetched")


def _unpacked(archive: Path, staging: Path, file: DataFile, entry: RegisteredWeights | None) -> dict[str, Any]:
    """Unpack an archive and check that it holds weights under the registry's licences; else remove it.

    Returns: what is known of the weights.
    """
    remove_own_folder(staging)
    make_own_folder(staging)
    try:
        unpack(archive, staging)
        facts = _facts(staging)
        licences = facts["licences"]
        if entry and set(licences) != set(entry.licences):
            raise InputError(
                f"The registry states the licences {entry.licence}, and the weights state "
                f"{'; '.join(licences) or 'none'}.",
                "Report it to the registry's maintainer; nothing was kept.",
            )
    except InputError:
        archive.unlink()
        raise
    source = staging / SOURCE_NAME
    source.unlink(missing_ok=True)  # an archive of weights that were fetched holds one
    write_flushed(source, json.dumps({"url": file.url, "checksum": file.checksum}).encode("utf-8"))
    return facts


def _wanted(config: Config) -> tuple[str, DataFile, RegisteredWeights | None]:
    """Name, archive, and entry of the registry, if the weights come from one."""
    if is_address(config.source):
        return _at_address(config)
    if config.registry is None:
        raise UsageError(
            f"{config.source} is not an address, and no registry is given.",
            "Give --registry FILE or --registry https://..., or the address of an archive.",
        )
    registry = read_registry(config.registry)
    if config.source not in registry:
        raise UsageError(
            f"The registry has no weights {config.source!r}.", f"It has {', '.join(registry) or 'none'}."
        )
    entry = registry[config.source]
    _check_name(config.source)
    suffix = _check_suffix(entry.url)
    try:
        file = entry.file(f"{config.source}{suffix}")
    except ValidationError as error:
        raise InputError(f"The registry's {config.source}: {error.errors()[0]['msg']}.", "Mend its url.") from None
    return config.source, file, entry


def _at_address(config: Config) -> tuple[str, DataFile, None]:
    if config.checksum is None:
        raise UsageError(
            "An archive that is given by its address needs its checksum.",
            "Give --checksum sha256:..., as its publisher states it.",
        )
    suffix = _check_suffix(config.source)
    archive = PurePosixPath(unquote(urlsplit(config.source).path)).name
    name = archive[: len(archive) - len(suffix)]
    _check_name(name)
    try:
        checksum = checked_sha256(config.checksum)
        return name, DataFile(name=f"{name}{suffix}", url=config.source, bytes=0, checksum=checksum), None
    except ValidationError as error:
        raise UsageError(f"{config.source}: {error.errors()[0]['msg']}.", "Check the address.") from None
    except ValueError as error:
        raise UsageError(f"--checksum {error}.", "Copy it from the publisher of the weights.") from None


def _check_suffix(address: str) -> str:
    suffix = archive_suffix(urlsplit(address).path)
    if not suffix:
        raise UsageError(f"{address} is not an archive.", f"Its name must end in {', '.join(ARCHIVE_SUFFIXES)}.")
    return suffix


def _check_name(name: str) -> None:
    if name in (*shipped_weights(), *shipped_task_weights()):
        raise UsageError(f"The weights {name} come with pumps.", f"Use them: --weights {name}.")
    if not NAME.fullmatch(name):
        raise UsageError(
            f"{name!r} cannot be a name of weights.", "Rename the archive, and use letters, digits, . _ -"
        )


def _check_place(target: Path, overwrite: bool) -> None:
    refuse_unmarked(target)
    if is_own_folder(target) and not overwrite:
        raise UsageError(f"{target} exists, and is of another archive.", "Give --overwrite to replace it.")


def _source_of(target: Path) -> dict[str, Any]:
    path = target / SOURCE_NAME
    if not is_own_folder(target) or not path.is_file():
        return {}
    with reading(path):
        found = json.loads(path.read_text(encoding="utf-8"))
    return found if isinstance(found, dict) else {}


def _facts(folder: Path) -> dict[str, Any]:
    """What is known of unpacked weights. Raises InputError where they are damaged."""
    return known_facts(folder.absolute())


def _report(target: Path, facts: dict[str, Any], config: Config, what: str) -> StageReport:
    used = str(target) if config.output else target.name
    lines = [
        f"{target.name} {what}: {facts['bytes'] / 1e6:.1f} MB in {target}.",
        *[f"Licence: {licence}" for licence in facts["licences"] or ["none stated"]],
        f"Next: pumps weights show {used}",
    ]
    return StageReport(output=target, lines=lines, figures={"name": target.name, "licences": facts["licences"]})
