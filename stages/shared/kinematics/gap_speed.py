"""The speed at which a body moves through a gap, compared with recordings of people."""

from __future__ import annotations

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.forward_numpy import positions_of

# Of 203,000 frames of motion capture (CMU, Bandai Namco, G1 moves, KayKit, ReActIdle; 30 to 120 a second), 99.9 % are
# slower than this in each set: pelvis 4.45 m/s and fastest joint 10.3 m/s in the fastest set, 4.3 and 10.0 over all.
PELVIS_MPS = 4.5
LIMB_MPS = 10.5
_SHOWN = 3


def sentences_of_speed(skeleton: Skeleton, filled: Motion, keys: np.ndarray, first: int) -> list[str]:
    """One sentence if the body moves faster in some gap than people do in recordings.

    Args:
        filled: T frames. keys: (K,) frames of it that are given, rising. first: the output's number of frame 0.
    """
    places = positions_of(skeleton, filled)
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=-1) * filled.fps
    speeds[:, ~np.asarray(skeleton.sampled, bool) & (np.arange(skeleton.joints) != skeleton.root)] = 0.0
    found = []
    for before, after in zip(keys, [*keys[1:], filled.frames], strict=True):
        steps = speeds[before:after]  # into each missing frame, and into the key after them
        if after - before < 2:
            continue
        limb = int(steps.max(axis=0).argmax())
        joint = skeleton.root if steps[:, skeleton.root].max() > PELVIS_MPS else limb
        most = float(steps[:, joint].max())
        if most > (PELVIS_MPS if joint == skeleton.root else LIMB_MPS):
            span = f"frames {before + 1 + first}-{after - 1 + first}"
            found.append((most, f"{skeleton.names[joint]} {most:.1f} m/s in {span}"))
    if not found:
        return []
    found.sort(key=lambda each: -each[0])
    shown = ", ".join(what for _, what in found[:_SHOWN])
    more = f" and {len(found) - _SHOWN} more gaps" if len(found) > _SHOWN else ""
    return [
        "Between these keys the body moves faster than in 99.9 % of recorded frames (pelvis "
        f"{PELVIS_MPS:g} m/s, other joints {LIMB_MPS:g} m/s): {shown}{more}. Move the keys beside these gaps further "
        "apart in time or closer in space."
    ]
