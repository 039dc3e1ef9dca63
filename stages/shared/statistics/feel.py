"""How a filled motion feels, beside its error: kinks at keys, sliding and sinking feet, shake (docs/evaluation.md).

These are properties of one motion. The truth has them too, so that its own stand beside those of every method; feet
and floor are judged where and while the *true* feet stand, so that all methods are judged in the same frames. Only
what was filled counts: pairs and runs of frames of which at least one was missing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Skeleton
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.foot_contacts import Feet, detect_contacts, find_feet, limb_joints
from stages.shared.statistics.feel_pops import (
    SHIN_RADIUS_SHARE,
    crossing_frames,
    floating_mm,
    jolts,
    largest_acceleration_mps2,
    largest_turn_deg,
    twists,
)
from stages.shared.statistics.measurements import Measurements, Truth, keys_beside_gaps

MILLIMETRES = 1000.0


@dataclass(frozen=True)
class TrueFeet:
    """Where and while the true feet of B windows stand.

    joints:   (F,) the contact joints, index into the skeleton.
    contacts: (B, T, F) bool, True while a joint stands (`stages.shared.kinematics.foot_contacts`).
    floors:   (B, F) metres: the lowest that a contact joint of its kind, toes or ankles, comes in the true window.
    shins:    (2, 2) knee and ankle of the left and the right leg, index into the skeleton.
    leg_m:    length of a leg, metres.
    """

    joints: np.ndarray
    contacts: np.ndarray
    floors: np.ndarray
    shins: np.ndarray
    leg_m: float


def true_feet(skeleton: Skeleton, positions: np.ndarray) -> TrueFeet | None:
    """The feet of true windows (B, T, J, 3) metres; None for a skeleton with no two legs."""
    try:
        feet = find_feet(skeleton)
    except InputError:
        return None
    contacts = np.stack([detect_contacts(window, feet, MODEL_FPS) for window in positions])
    shins = limb_joints(skeleton, feet)[:, 1:]
    return TrueFeet(feet.joints, contacts, _floors(positions, feet), shins, feet.leg_m)


def feel(
    positions: np.ndarray,
    rotations: np.ndarray,
    truth: Truth,
    joints: np.ndarray,
    feet: TrueFeet | None,
    fell_back: np.ndarray | None = None,
    seams: np.ndarray | None = None,
) -> Measurements:
    """The figures of B windows; NaN where a window cannot tell one.

    Args:
        positions: (B, T, J, 3) metres, of a method or of the truth itself, at 30 frames a second.
        rotations: (B, T, J, 4) global quaternions, xyzw.
        joints: those that count.
        fell_back: (B, T, J) bool, True where a model left the plain interpolation as it is.
        seams: (K,) frames at which models' windows meet.
    """
    missing = ~truth.known
    found = {
        "key_jump_mps": key_jump_mps(positions[:, :, joints], keys_beside_gaps(truth.known)),
        "jerk_mps3": jerk_mps3(positions[:, :, joints], missing),
        **_pops(positions[:, :, joints], rotations[:, :, joints], truth, joints),
    }
    if seams is not None and len(seams):
        found["seam_share"] = seam_share(positions[:, :, joints], missing, seams)
    if feet is not None:
        found["foot_skate_mps"] = foot_skate_mps(positions[:, :, feet.joints], feet.contacts, missing)
        found["floor_penetration_mm"] = floor_penetration_mm(positions[:, :, feet.joints], feet, missing)
        heights = positions[:, :, feet.joints, 1]
        found["floating_mm"] = floating_mm(heights, feet.floors, feet.contacts, missing)
        radius = SHIN_RADIUS_SHARE * feet.leg_m
        found["crossing_frames"] = crossing_frames(positions[:, :, feet.shins], missing, radius)
    if fell_back is not None:
        found["fell_back_share"] = fell_back[:, missing][:, :, joints].mean(axis=(1, 2))
    return {name: (values, np.ones(len(values))) for name, values in found.items()}


def _pops(positions: np.ndarray, rotations: np.ndarray, truth: Truth, joints: np.ndarray) -> dict[str, np.ndarray]:
    """Largest turn and acceleration of the joints that count, and whether they are a twist or a jolt."""
    missing = ~truth.known
    turns, true_turns = (largest_turn_deg(each, missing) for each in (rotations, truth.rotations[:, :, joints]))
    places = (positions, truth.positions[:, :, joints])
    accelerations, true_accelerations = (largest_acceleration_mps2(each, missing) for each in places)
    return {
        "largest_turn_deg": turns,
        "largest_acceleration_mps2": accelerations,
        "twist_share": twists(turns, true_turns),
        "jolt_share": jolts(accelerations, true_accelerations),
    }


def key_jump_mps(positions: np.ndarray, keys: np.ndarray) -> np.ndarray:
    """(B,) mean change of a joint's velocity at the frames `keys` (K,), none of them first or last; metres a second.

    Slerp's kinks show in it. NaN where there is no key.
    """
    if len(keys) == 0:
        return np.full(len(positions), np.nan)
    before, at, after = (np.asarray(positions[:, keys + step], np.float64) for step in (-1, 0, 1))
    return MODEL_FPS * np.linalg.norm(after - 2 * at + before, axis=-1).mean(axis=(1, 2))


def seam_share(positions: np.ndarray, missing: np.ndarray, seams: np.ndarray) -> np.ndarray:
    """(B,) how much more velocity changes at missing frames where windows meet than at all other missing frames, mean
    over joints. The truth has about 1, except where these frames lie in their gaps; a pop would lie above. NaN
    where one kind is missing, or nothing moves."""
    inside = missing.copy()
    inside[[0, -1]] = False
    at_seam = np.zeros_like(inside)
    at_seam[seams] = True
    if not (inside & at_seam).any() or not (inside & ~at_seam).any():
        return np.full(len(positions), np.nan)
    bends = np.zeros(positions.shape[:2])
    bends[:, 1:-1] = np.linalg.norm(np.diff(np.asarray(positions, np.float64), n=2, axis=1), axis=-1).mean(axis=-1)
    here, elsewhere = (bends[:, inside & kind].mean(axis=1) for kind in (at_seam, ~at_seam))
    return np.where(elsewhere > 1e-7, here / np.maximum(elsewhere, 1e-7), np.nan)


def jerk_mps3(positions: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """(B,) mean norm of the third differences of positions (B, T, J, 3) over runs of four frames, one of which at
    least is missing (T,); metres a second cubed. Beside the truth's, less is too smooth and more is shake."""
    touched = np.convolve(missing, np.ones(4), mode="valid") > 0
    if not touched.any():
        return np.full(len(positions), np.nan)
    thirds = np.diff(np.asarray(positions, np.float64), n=3, axis=1)[:, touched]
    return MODEL_FPS**3 * np.linalg.norm(thirds, axis=-1).mean(axis=(1, 2))


def foot_skate_mps(positions: np.ndarray, contacts: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """(B,) mean horizontal speed of contact joints (B, T, F, 3) over pairs of neighbouring frames in both of which
    they stand (B, T, F) and one of which at least is missing (T,); metres a second, NaN where none stands."""
    both = contacts[:, 1:] & contacts[:, :-1] & (missing[1:] | missing[:-1])[:, None]
    steps = np.diff(np.asarray(positions, np.float64)[..., [0, 2]], axis=1)
    speeds = MODEL_FPS * np.linalg.norm(steps, axis=-1)
    count = both.sum(axis=(1, 2))
    return np.where(count > 0, (speeds * both).sum(axis=(1, 2)) / np.maximum(count, 1), np.nan)


def floor_penetration_mm(positions: np.ndarray, feet: TrueFeet, missing: np.ndarray) -> np.ndarray:
    """(B,) how far the deepest contact joint (B, T, F, 3) lies below the floor, mean over missing frames; mm.

    The truth's is 0 by the definition of the floor. NaN in windows in which no true foot stands: what is lowest in
    them may be no floor.
    """
    depths = np.maximum(feet.floors[:, None] - positions[..., 1], 0.0)[:, missing].max(axis=-1)
    return np.where(feet.contacts.any(axis=(1, 2)), MILLIMETRES * depths.mean(axis=1), np.nan)


def _floors(positions: np.ndarray, feet: Feet) -> np.ndarray:
    lowest = positions[:, :, feet.joints, 1].min(axis=1)
    floors = np.empty_like(lowest)
    for kind in (False, True):
        alike = feet.is_end == kind
        if alike.any():
            floors[:, alike] = lowest[:, alike].min(axis=1, keepdims=True)
    return floors
