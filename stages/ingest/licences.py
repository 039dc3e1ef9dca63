"""Licences of data sets that are known by the names of their archives or folders."""

from __future__ import annotations

from fnmatch import fnmatch

from stages.shared.catalogue.catalogue import data_sets_by_archive

UNKNOWN = "unknown"
_CMU = (
    "CMU Graphics Lab Motion Capture Database: free for research and commercial products, not to be resold as data,"
    " even converted. The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with"
    " funding from NSF EIA-0196217."
)
_KNOWN = (
    ("bandai-namco*", "CC BY-NC 4.0 (c) Bandai Namco Research Inc."),
    ("bandai*namco*", "CC BY-NC 4.0 (c) Bandai Namco Research Inc."),
    ("cmu*", _CMU),
    ("g1-moves*", "CC BY 4.0 (c) Experiential Technologies"),
    ("lafan1*", "CC BY-NC-ND 4.0 (c) Ubisoft"),
    ("100style*", "CC BY 4.0 (c) Ian Mason"),
)


def licence_of(data_set: str, given: str | None) -> str:
    """The licence of a recording of a data set; the user's setting takes precedence."""
    if given:
        return given
    for pattern, licence in _KNOWN:
        if fnmatch(data_set.lower(), pattern):
            return licence
    known = data_sets_by_archive().get(data_set)
    return known[1].licence if known else UNKNOWN
