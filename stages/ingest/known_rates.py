"""True frame rates that the catalogue states for recordings whose files state a wrong one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from fnmatch import fnmatch

from stages.shared.catalogue.catalogue import data_sets_by_archive
from stages.shared.formats.sources import Source


def known_rate(source: Source) -> float | None:
    """Frames a second that the catalogue states for a recording of an archive that it knows by name; else None."""
    found = data_sets_by_archive().get(source.data_set)
    if found is None:
        return None
    return next((fps for pattern, fps in found[1].true_fps.items() if fnmatch(source.member, pattern)), None)


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
