"""What the catalogue knows of recordings whose files do not tell it: true frame rates, and rigs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

from data_schemas.errors import InputError
from stages.shared.catalogue.catalogue import data_sets_by_archive
from stages.shared.formats.recording import Asked
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.sources import Source


def known_rate(source: Source) -> float | None:
    """Frames a second that the catalogue states for a recording of an archive that it knows by name; else None."""
    found = data_sets_by_archive().get(source.data_set)
    if found is None:
        return None
    return next((fps for pattern, fps in found[1].true_fps.items() if fnmatch(source.member, pattern)), None)


def known_rig(source: Source) -> tuple[bytes, str]:
    """Bytes and name of the rig that the catalogue states for a recording's archive; empty where there is none.

    The rig lies in another archive in the same folder; where that is not there, there is no rig.
    """
    found = data_sets_by_archive().get(source.data_set) if source.archive else None
    if found is None or not found[1].rig:
        return b"", ""
    return _rig(str(Path(source.archive).parent / found[1].rig))


@cache
def _rig(name: str) -> tuple[bytes, str]:
    try:
        return rig_named(name)
    except InputError:
        return b"", ""


def asked_of(source: Source, asked: Asked, fps: float | None) -> Asked:
    """What holds for one source: its true rate, and the catalogue's rig where none was given."""
    if asked.rig or asked.rig_name:
        return replace(asked, fps_override=fps)
    rig, rig_name = known_rig(source)
    return replace(asked, fps_override=fps, rig=rig, rig_name=rig_name)


def rate_notes(sources: Sequence[Source], rates: Mapping[str, float | None]) -> list[str]:
    """One sentence for each archive and rate that was taken from the catalogue.

    Args:
        rates: name of a source -> its rate by the catalogue, or None.
    """
    counts = Counter((source.data_set, fps) for source in sources if (fps := rates.get(source.name)) is not None)
    return [
        f"{data_set}: {count} file{'s' if count > 1 else ''} read at {fps:g} frames a second, as the catalogue of"
        " data sets states; --fps-override sets another rate."
        for (data_set, fps), count in counts.items()
    ]
