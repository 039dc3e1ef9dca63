"""Which licences this user has accepted: shown and asked once, and kept in the user's own settings folder."""

from __future__ import annotations

import json
from pathlib import Path

import platformdirs

from data_schemas.errors import UsageError
from data_schemas.whole_file import write_whole
from stages.shared.catalogue.catalogue import DataSet


def acceptance_file() -> Path:
    """Where acceptances are kept."""
    return platformdirs.user_config_path("pumps") / "accepted_licences.json"


def require_acceptance(name: str, data_set: DataSet, accepted_now: bool, file: Path) -> None:
    """Pass if this licence of this data set was accepted before or is accepted now, which is then remembered.

    Raises: UsageError that shows the licence.
    """
    accepted = _read(file)
    if accepted.get(name) == data_set.licence:
        return
    if not accepted_now:
        raise UsageError(
            f"{name} comes under its own licence: {data_set.licence} ({data_set.licence_url}). {data_set.terms}",
            "If you accept it, run the command again with --accept-licence; you will not be asked again.",
        )
    write_whole(file, json.dumps({**accepted, name: data_set.licence}, indent=1).encode())


def _read(file: Path) -> dict[str, str]:
    try:
        found = json.loads(file.read_bytes())
    except (OSError, ValueError):
        return {}  # nothing readable is nothing accepted: the user is asked again
    return found if isinstance(found, dict) else {}
