"""The speed at which a body must move from key to key, however a gap is filled."""

from __future__ import annotations

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.forward_numpy import positions_of

# Of 203,000 frames of motion capture (CMU, Bandai Namco, G1 moves, KayKit, ReActIdle; 30 to 120 a second), 99.9 % are
# slower than this in each set: pelvis 4.45 m/s and fastest joint 10.3 m/s in the fastest set, 4.3 and 10.0 over all.
PELVIS_MPS = 4.5
LIMB_MPS = 10.5
_SHOWN = 3


def sentences_of_speed(skeleton: Skeleton, key_motion: Motion, keys: np.ndarray, fps: float) -> list[str]:
    """A sentence where the keys on both sides of a gap ask for more speed than people show in recordings.

    Args:
        key_motion: the K keys as its frames. keys: (K,) frames of the output, rising. fps: of the output.
    """
    gaps = np.flatnonzero(np.diff(keys) > 1)
    if not len(gaps):
        return []
    at_edges = np.unique(np.concatenate([gaps, gaps + 1]))
    places = positions_of(skeleton, key_motion.at(at_edges))
    before, after = np.searchsorted(at_edges, gaps), np.searchsorted(at_edges, gaps + 1)
    seconds = (keys[gaps + 1] - keys[gaps]) / fps
    speeds = np.linalg.norm(places[after] - places[before], axis=-1) / seconds[:, None]
    pelvis = speeds[:, skeleton.root]
    limbs = np.where(np.asarray(skeleton.sampled, bool), speeds, 0.0)
    fastest = limbs.argmax(axis=1)
    found = []
    for gap in np.flatnonzero((pelvis > PELVIS_MPS) | (limbs.max(axis=1) > LIMB_MPS)):
        too_fast = pelvis[gap] > PELVIS_MPS
        joint = skeleton.root if too_fast else int(fastest[gap])
        first, last = int(keys[gaps[gap]]), int(keys[gaps[gap] + 1])
        found.append((float(speeds[gap, joint]), f"{skeleton.names[joint]} from key {first} to key {last} at "))
    found.sort(key=lambda each: -each[0])
    if not found:
        return []
    shown = ", ".join(f"{what}{speed:.1f} m/s" for speed, what in found[:_SHOWN])
    more = f" and {len(found) - _SHOWN} more gaps" if len(found) > _SHOWN else ""
    return [
        f"The keys ask for more speed than 99.9 % of recorded frames show (pelvis {PELVIS_MPS:g} m/s, other joints "
        f"{LIMB_MPS:g} m/s): {shown}{more}. Move these keys further apart in time or closer together in space."
    ]
