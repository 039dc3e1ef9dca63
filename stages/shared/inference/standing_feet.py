"""When the feet of a filled motion stand, and where.

Filled feet glide where true ones stand. So a foot stands if it is slow compared with its own steps, or if it is low
and at the same place in the keys on both sides. The place follows from the keys, or else from the filled path.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from stages.shared.kinematics.foot_contacts import (
    HEIGHT_SHARE,
    SPEED_SHARE,
    Feet,
    contact_speeds,
    detect_contacts,
    floor_levels,
)
from stages.shared.kinematics.runs import runs_of

# A filled foot is slow up to this share of its own fastest within so many seconds, at most so many legs a second.
SLOW_SHARE, FASTEST_WITHIN_S, SLOW_AT_MOST = 0.7, 1.0, 2.5
FURTHEST_SHARE = 0.25  # of the leg: a foot that would have to be moved further was not a standing one
# A body flies where its pelvis, on average over so many seconds before and after, falls with this share of gravity.
GRAVITY_MPS2, FLIGHT_SHARE, FALL_S = 9.81, 0.5, 0.1


def standing_feet(positions: np.ndarray, feet: Feet, fps: float, known: np.ndarray) -> np.ndarray:
    """(T, F) bool: contact joints that stand, in a motion of which some frames are filled.

    The definition is that of `detect_contacts` with the floor of the known frames, but the limit on speed follows
    from the foot's own fastest step nearby. In addition, a joint that is low in two neighbouring keys, at nearly the
    same place, stands in all frames between them in which it stays low. A joint that is further from its place than
    `FURTHEST_SHARE` of the leg does not stand.
    """
    levels = floor_levels(positions, feet, known)
    speeds = contact_speeds(positions, feet, fps)
    fastest = maximum_filter1d(speeds, 2 * round(FASTEST_WITHIN_S * fps) + 1, axis=0)
    slow = np.clip(SLOW_SHARE * fastest, SPEED_SHARE * feet.leg_m, SLOW_AT_MOST * feet.leg_m)
    contacts = detect_contacts(positions, feet, fps, levels=levels, slow_mps=slow)
    low = positions[:, feet.joints, 1] - levels <= HEIGHT_SHARE * feet.leg_m
    keys = np.flatnonzero(known)
    for first, last in pairwise(keys):
        if last - first < 2:
            continue
        apart = np.linalg.norm(positions[last, feet.joints] - positions[first, feet.joints], axis=-1)
        near = apart <= min(SPEED_SHARE * (last - first) / fps / 2, SPEED_SHARE / 3) * feet.leg_m
        planted = low[first] & low[last] & near
        contacts[first : last + 1] |= low[first : last + 1] & planted
    away = np.linalg.norm(held_shifts(positions, contacts, feet, known), axis=-1)
    contacts &= away <= FURTHEST_SHARE * feet.leg_m
    return contacts


def held_shifts(positions: np.ndarray, contacts: np.ndarray, feet: Feet, known: np.ndarray) -> np.ndarray:
    """(T, F, 3) metres, from the contact joints' paths to the places that they are to keep while they stand.

    Args:
        positions: (T, J, 3) metres. contacts: (T, F) bool. known: (T,) bool.
    """
    paths = positions[:, feet.joints].astype(np.float64)
    heights = contact_heights(positions, feet, known)
    out = np.zeros(paths.shape)
    for column, path in enumerate(np.moveaxis(paths, 1, 0)):
        for run in runs_of(contacts[:, column]):
            keys = run[known[run]]
            if len(keys):
                place = np.stack([np.interp(run, keys, path[keys, axis]) for axis in range(3)], -1)
            else:
                place = np.tile(path[run].mean(0), (len(run), 1))
                place[:, 1] = heights[run, column]
            out[run, column] = place - path[run]
    return out


def contact_heights(positions: np.ndarray, feet: Feet, known: np.ndarray) -> np.ndarray:
    """(T, F) metres: height at which a contact joint stands, from the known frames in which it is low.

    Between two such frames the heights lie on a line. A joint that is low in none stands at its floor's level.
    """
    levels = floor_levels(positions, feet, known)
    heights = positions[:, feet.joints, 1]
    low = known[:, None] & (heights - levels <= HEIGHT_SHARE * feet.leg_m)
    frames = np.arange(len(positions))
    columns = [
        np.interp(frames, np.flatnonzero(stands), column[stands]) if stands.any() else np.full(len(frames), level)
        for stands, column, level in zip(low.T, heights.T, levels, strict=True)
    ]
    return np.stack(columns, axis=1)


def lowered_feet(
    positions: np.ndarray, contacts: np.ndarray, feet: Feet, pelvis: int, known: np.ndarray, fps: float
) -> np.ndarray:
    """(T, F) metres, at most 0: how far the contact joints of the lower foot are to come down where both feet float.

    Both float where neither stands, in a gap at both of whose keys a contact joint is low, and the body does not fly:
    its pelvis does not fall as freely as `FLIGHT_SHARE` of gravity. A foot that would have to come down further than
    `FURTHEST_SHARE` of the leg stays.
    """
    above = positions[:, feet.joints, 1].astype(np.float64) - contact_heights(positions, feet, known)
    low = np.asarray((above <= HEIGHT_SHARE * feet.leg_m).any(1))
    keys = np.flatnonzero(known)
    floats = ~contacts.any(1) & ~known
    for first, last in pairwise(keys):
        floats[first : last + 1] &= low[first] & low[last]
    floats[: keys[0]] = floats[keys[-1] :] = False
    fall = np.zeros(len(known))
    fall[1:-1] = -np.diff(positions[:, pelvis, 1].astype(np.float64), n=2) * fps**2
    floats &= uniform_filter1d(fall, 2 * round(FALL_S * fps) + 1) < FLIGHT_SHARE * GRAVITY_MPS2
    lowest = above.min(1)
    floats &= (lowest > 0) & (lowest <= FURTHEST_SHARE * feet.leg_m)
    lower = feet.groups == feet.groups[above.argmin(1)][:, None]
    return np.where(floats[:, None] & lower, -lowest[:, None], 0.0)
