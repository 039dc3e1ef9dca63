"""Places of joints or markers as a file holds them, before it is known which skeleton they belong to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Note


@dataclass(frozen=True)
class MeasuredPositions:
    """The content of a file of positions.

    places: (T, J, 3) in the file's own unit and axes, NaN where missing. names, parents: J of them, or empty.
    fps: frames a second, None if not stated. unit_m: metres in one unit, None if not stated.
    notes: what was left out or assumed.
    """

    places: np.ndarray
    names: tuple[str, ...] = ()
    parents: tuple[int, ...] = ()
    fps: float | None = None
    unit_m: float | None = None
    notes: tuple[Note, ...] = ()


def sensible_rate(fps: float, name: str) -> float:
    """The rate itself. Raises InputError if no motion has such a rate."""
    if not 0.1 <= fps <= 10_000:
        raise InputError(f"{name}: its rate is {fps:g} frames a second.", "Give the true rate with --fps-override.")
    return fps
