"""Licences that this user has accepted: each is asked for once and stored in the user's settings folder."""

from __future__ import annotations

import json
from pathlib import Path

import platformdirs

from data_schemas.errors import UsageError
from data_schemas.whole_file import write_whole
from stages.shared.catalogue.catalogue import DataSet


def acceptance_file() -> Path:
    """The file that stores accepted licences."""
    return platformdirs.user_config_path("pumps") / "accepted_licences.json"


def require_acceptance(name: str, data_set: DataSet, accepted_now: bool, file: Path) -> None:
    """Check that this licence of this data set was accepted before, or is accepted now, which is then stored.

    Raises: UsageError with the licence, if it is not accepted.
    """
    accepted = _read(file)
    if accepted.get(name) == data_set.licence:
        return
    if not accepted_now:
        raise UsageError(
            f"{name} has its own licence: {data_set.licence} ({data_set.licence_url}). {data_set.terms}",
            "If you accept it, run the command again with --accept-licence; you will not be asked again.",
        )
    write_whole(file, json.dumps({**accepted, name: data_set.licence}, indent=1).encode())


def _read(file: Path) -> dict[str, str]:
    try:
        found = json.loads(file.read_bytes())
    except (OSError, ValueError):
        return {}  # an unreadable file counts as empty: the user is asked again
    return found if isinstance(found, dict) else {}
