"""TRC files for tests."""

from __future__ import annotations

import numpy as np


def trc_of(
    names: list[str], places: np.ndarray, units: str = "m", rate: str = "50", blank_line: bool = True
) -> bytes:
    heads = [
        "PathFileType\t4\t(X/Y/Z)\twalk.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{len(places)}\t{len(names)}\t{units}\t{rate}\t1\t{len(places)}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(len(names)) for axis in "XYZ"),
    ]
    rows = [
        "\t".join([str(i + 1), f"{i / 50:.6f}", *("" if np.isnan(v) else repr(float(v)) for v in frame.reshape(-1))])
        for i, frame in enumerate(places)
    ]
    return "\r\n".join([*heads, *([""] if blank_line else []), *rows, ""]).encode()
