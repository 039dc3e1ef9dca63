"""Warnings about a recording: each is a sentence that names the place and how to correct it."""

from __future__ import annotations

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.anatomy import RigAnatomy

_JUMP_M_S = 30.0  # no joint of a body moves so fast
_UNSURE = 0.25
_UNEQUAL = 1.15
_STRETCH_M = 0.02
_SUNK_M = -0.3
_USUAL_RATES = (24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150, 180, 200, 240)


def suspicions_of(
    skeleton: Skeleton,
    motion: Motion,
    places: np.ndarray,
    anatomy: RigAnatomy,
    dropped: int = 0,
    *,
    rate_given: bool = False,
) -> list[str]:
    """Sentences on what a user should check before using the file.

    Args:
        places: (T, J, 3) joints, metres, Y up.
        rate_given: the frame rate is the user's own.
        dropped: frames of the file before the motion's first frame, added to frame numbers in the sentences.
    """
    return [
        *_of_the_body(skeleton, anatomy),
        *([] if rate_given else _of_the_rate(motion)),
        *_of_the_movement(skeleton, motion, places, dropped),
        *_of_the_places(skeleton, motion, places),
    ]


def _of_the_body(skeleton: Skeleton, anatomy: RigAnatomy) -> list[str]:
    out = []
    sides, groups = anatomy.findings["sides"], anatomy.findings["groups"]
    if anatomy.sides_look_swapped:
        out.append("Left and right seem to be swapped: by the sides in the names, toes and knees point backwards.")
    elif sides.how == "pose" and sides.sure < _UNSURE:
        out.append(
            "Left and right are uncertain; check them, and correct them with --skeleton-map if they are wrong."
        )
    if groups.how == "shape" and groups.sure < _UNSURE:
        out.append("The limbs are uncertain; check the body groups, and correct them with --map and --skeleton-map.")
    unequal = []
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    for left, right in anatomy.pairs:
        shorter, longer = sorted((lengths[left], lengths[right]))
        if skeleton.groups[left] > 0 and longer > 0.02 and longer > _UNEQUAL * shorter:
            unequal.append(f"{skeleton.names[left]} {lengths[left] * 100:.1f} and {lengths[right] * 100:.1f} cm")
    if unequal:
        more = f" and {len(unequal) - 3} more" if len(unequal) > 3 else ""
        out.append(f"Bones differ between left and right: {', '.join(unequal[:3])}{more}.")
    return out


def _of_the_rate(motion: Motion) -> list[str]:
    if motion.fps < 10 or min(abs(motion.fps - rate) / rate for rate in _USUAL_RATES) > 0.002:
        return [f"{motion.fps:.4g} frames a second is an unusual rate; give --fps-override if it is wrong."]
    return []


def _of_the_movement(skeleton: Skeleton, motion: Motion, places: np.ndarray, dropped: int) -> list[str]:
    if motion.frames < 2:
        return ["There is only one frame: a pose, not a motion."]
    speeds = np.linalg.norm(np.diff(places[:, skeleton.sampled], axis=0), axis=-1) * motion.fps
    fastest = speeds.max(axis=1, initial=0.0)
    if fastest.max() < 1e-3:
        return ["Nothing moves."]
    jumps = np.flatnonzero(fastest > _JUMP_M_S)
    if not len(jumps):
        return []
    where = ", ".join(str(frame + 1 + dropped) for frame in jumps[:5]) + (", ..." if len(jumps) > 5 else "")
    return [f"Some joint moves faster than {_JUMP_M_S:g} m/s into frame {where}: a jump, or a wrong frame time."]


def _of_the_places(skeleton: Skeleton, motion: Motion, places: np.ndarray) -> list[str]:
    out = []
    stretched = []
    for track, joint in enumerate(motion.track_joints):
        spread = float(np.ptp(np.linalg.norm(motion.tracks[:, track], axis=-1)))
        if skeleton.groups[joint] >= 0 and joint != skeleton.root and spread > _STRETCH_M:
            stretched.append(f"{skeleton.names[joint]} by {spread * 100:.0f} cm")
    if stretched:
        more = f" and {len(stretched) - 3} more" if len(stretched) > 3 else ""
        out.append(f"Bones change their length: {', '.join(stretched[:3])}{more}.")
    lowest = float(np.percentile(places[:, skeleton.sampled, 1].min(axis=1), 5))
    if lowest < _SUNK_M:
        out.append(
            f"The body reaches {-lowest:.2f} m below the floor at 0: check the floor's height and the up axis."
        )
    return out
