"""Licences that this user has accepted: each is asked for once and stored in the user's settings folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Protocol

import platformdirs

from data_schemas.errors import UsageError
from data_schemas.whole_file import write_whole


class Licensed(Protocol):
    """What is downloaded under a licence of its own. licence_url and terms may be empty."""

    @property
    def licence(self) -> str: ...
    @property
    def licence_url(self) -> str: ...
    @property
    def terms(self) -> str: ...


def acceptance_file() -> Path:
    """The file that stores accepted licences."""
    return platformdirs.user_config_path("pumps") / "accepted_licences.json"


def require_acceptance(name: str, licensed: Licensed, accepted_now: bool, file: Path) -> None:
    """Check that the licence of what has this name was accepted before, or is accepted now, which is then stored.

    Raises: UsageError with the licence, if it is not accepted.
    """
    accepted = _read(file)
    if accepted.get(name) == licensed.licence:
        return
    if not accepted_now:
        where = f" ({licensed.licence_url})" if licensed.licence_url else ""
        raise UsageError(
            f"{name} has its own licence: {licensed.licence}{where}. {licensed.terms}".rstrip(),
            "If you accept it, run the command again with --accept-licence; you will not be asked again.",
        )
    write_whole(file, json.dumps({**accepted, name: licensed.licence}, indent=1).encode())


def _read(file: Path) -> dict[str, str]:
    try:
        found = json.loads(file.read_bytes())
    except (OSError, ValueError):
        return {}  # an unreadable file counts as empty: the user is asked again
    return found if isinstance(found, dict) else {}
