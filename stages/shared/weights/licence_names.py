"""Licences as a line names them; the whole sentences stand in `pumps weights show`."""

from __future__ import annotations

import re
from collections.abc import Sequence

_END = re.compile(r"(?::|\(c\)|©|,\s*copyright\b)", re.IGNORECASE)  # what follows says of whom and on what terms
_LONGEST = 60  # characters


def licence_names(licences: Sequence[str]) -> str:
    """The names of licences without holders and terms, each once, joined by commas; "none named" for none.

    Args:
        licences: sentences as manifests hold them, such as `CC BY 4.0 (c) Somebody` or `MIT: Data, Copyright ...`.
    """
    return ", ".join(dict.fromkeys(map(_name, licences))) or "none named"


def _name(licence: str) -> str:
    name = _END.split(licence, maxsplit=1)[0].strip().rstrip(".") or licence.strip()
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 3].rstrip()}..."
