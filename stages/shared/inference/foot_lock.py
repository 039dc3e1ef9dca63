"""Feet that stand stay where they stand: a clean-up of filled frames that moves legs and nothing else.

While a contact joint stands (`stages.shared.kinematics.foot_contacts`), its foot is shifted as a whole to one place:
through the keys' own places where keys are among the frames, else to the mean. The shift comes and goes smoothly, is
nothing at every key; and no foot comes lower than the lowest does in the known frames. The leg's joints above the
foot are solved for it over time (`stages.shared.solve.limb_solve`). The foot keeps its direction, the pelvis its
place. Hips and knees turn about the axes about which they turn in the keys, so that no knee flips.

Holding a foot must not cause a pop. `_eased` reduces the shift of a leg that turns or accelerates too much. The limit
is the larger of two values, times `MORE`: the most that either leg of the filled motion does in the same gap, and the
values of a calm motion (`CALM_DEG_PER_S`, `CALM_MPS2`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from scipy.ndimage import maximum_filter1d
from torch import Tensor

from stages.shared.kinematics.foot_contacts import (
    HEIGHT_SHARE,
    SPEED_SHARE,
    Feet,
    contact_speeds,
    detect_contacts,
    find_feet,
    floor_levels,
    limb_joints,
)
from stages.shared.kinematics.rotations import conjugate, multiply
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.limb_solve import Limb, solve_limb
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.solve.smoothing import smooth_corrections

SMOOTH_S, LOOSE = 0.06, 0.005
# A filled foot is slow up to this share of its own fastest within so many seconds, at most so many legs a second.
SLOW_SHARE, FASTEST_WITHIN_S, SLOW_AT_MOST = 0.7, 1.0, 2.5
FURTHEST_SHARE = 0.25  # of the leg: a foot that would have to be moved further was not a standing one
NOISE_M = 0.004  # how closely a foot meets its place
OPEN_RAD = 0.5  # how far a leg's joint may turn about an axis about which the keys do not turn it
# A leg may turn and accelerate so much, whatever the filled motion does: degrees a second, metres a second squared.
CALM_DEG_PER_S, CALM_MPS2 = 300.0, 25.0
MORE = 1.25  # factor on both limits
FLOOR_ROUNDS = 3
LET_GO, ROUNDS, NEAR_S = (
    0.6,
    8,
    0.2,
)  # share of a shift that a round keeps; rounds until it is 0; seconds around


@dataclass(frozen=True)
class _Leg:
    """A leg over all T frames, and what it does by itself.

    ankle:  its first contact joint, index into the skeleton.
    joints: (n,) from the hip to the joint above the ankle, index into the skeleton.
    prior:  (n, 3, 3) of their turns.
    """

    ankle: int
    joints: list[int]
    limb: Limb
    prior: np.ndarray


def lock_feet(pose: SkeletonPose, known: np.ndarray, fps: float) -> SkeletonPose:
    """Hold standing feet in the frames that are not known.

    A leg without a joint above its first contact joint cannot be moved, and stays as it is.

    Args:
        pose: T frames, filled, `fps` a second. known: (T,) bool; known frames come back value for value.

    Raises: InputError where the skeleton has no two legs.
    """
    feet = find_feet(pose.skeleton)
    places = pose.heads.numpy()
    contacts = standing_feet(places, feet, fps, known)
    gaps = np.flatnonzero(~known)
    legs = _legs_of(pose, feet, known)
    wanted = [_wanted_shift(places, contacts, feet, group, known) for group in legs]
    if len(gaps) == 0 or not any(leg.held.any() or leg.heights.min() < leg.floors.min() for leg in wanted):
        return pose
    turns = _eased(list(legs.values()), wanted, known, fps)
    return pose.with_rows(gaps, _with_legs_turned(pose.by_local(), list(legs.values()), turns).rows(gaps))


def standing_feet(positions: np.ndarray, feet: Feet, fps: float, known: np.ndarray) -> np.ndarray:
    """(T, F) bool: contact joints that stand, in a motion of which some frames are filled.

    By the definition of `detect_contacts`, with the floor of the known frames, but that slow is what is slow beside
    the foot's own steps: filled feet glide where true ones stand and step, and of what stands at 0.35 legs a second
    only seven tenths is found, of this nine tenths. And between two neighbouring keys in
    both of which a joint is low, in places that it could not have left and come back to while standing slow, all
    frames in which it stays low: that it slides there is the filling's doing. A joint that is further from its place
    than `FURTHEST_SHARE` of the leg does not stand.
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
    for column, joint in enumerate(feet.joints):
        away = np.linalg.norm(_held(positions[:, joint], contacts[:, column], known), axis=-1)
        contacts[:, column] &= away <= FURTHEST_SHARE * feet.leg_m
    return contacts


@dataclass(frozen=True)
class _Wanted:
    """What is wanted of one leg's foot over T frames.

    shifts:  (T, 3) metres, in the frames in which it is held, elsewhere 0.
    held:    (T,) bool.
    heights: (T, M) of its contact joints, metres.
    floors:  (M,) the lowest that a contact joint of each kind comes in a known frame.
    """

    shifts: np.ndarray
    held: np.ndarray
    heights: np.ndarray
    floors: np.ndarray

    def path(self, trust: np.ndarray, floor_trust: np.ndarray, known: np.ndarray, fps: float) -> np.ndarray:
        """(T, 3) shifts that come and go smoothly: of stands and out of the floor, each times its trust (T,)."""
        path = _smooth(trust[:, None] * self.shifts, self.held, known, fps)
        wanted = np.zeros((len(known), 1))
        lift = wanted
        for _ in range(FLOOR_ROUNDS):  # what the smoothing leaves below the floor is asked for again
            sunk = (self.floors - (self.heights + path[:, 1:2] + lift)).max(1, keepdims=True)
            wanted = wanted + np.where(known[:, None], 0.0, np.maximum(sunk, 0.0))
            lift = _smooth(wanted, wanted[:, 0] > 0, known, fps)
        path[:, 1:2] += _smooth(floor_trust[:, None] * wanted, wanted[:, 0] > 0, known, fps)
        return path


def _wanted_shift(places: np.ndarray, contacts: np.ndarray, feet: Feet, group: int, known: np.ndarray) -> _Wanted:
    """What is wanted of the foot of the leg of this body group."""
    heights = places[:, feet.joints, 1]
    lowest = np.array([heights[known][:, feet.is_end == end].min() for end in feet.is_end])
    members = np.flatnonzero(feet.groups == group)
    wanted = np.stack([_held(places[:, feet.joints[m]], contacts[:, m], known) for m in members], axis=1)
    held = contacts[:, members]
    own = (wanted * held[..., None]).sum(1) / np.maximum(held.sum(1, keepdims=True), 1)
    return _Wanted(own, np.asarray(held.any(1)), heights[:, members], lowest[members])


def _held(path: np.ndarray, stands: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(T, 3) from a joint's path to the place it is to keep, in the frames in which it stands."""
    out = np.zeros((len(path), 3))
    for run in _runs(stands):
        keys = run[known[run]]
        if len(keys):
            place = np.stack([np.interp(run, keys, path[keys, axis]) for axis in range(3)], -1)
        else:
            place = path[run].mean(0)
        out[run] = place - path[run]
    return out


def _smooth(shifts: np.ndarray, held: np.ndarray, known: np.ndarray, fps: float) -> np.ndarray:
    """Shifts (T, 3) that follow those of the held frames, die away between them, and are nothing at keys.

    A foot that stops to stand, or that changes from heel to toe, must not jump: of all paths the one is taken that is
    near to what is wanted and bends little (Whittaker's smoother: squares of second differences), in held frames
    within `SMOOTH_S`, elsewhere, where little is wanted, within what follows from `LOOSE`.
    """
    wanted = np.where(held[:, None], shifts, 0.0)
    frames, weights = np.arange(float(len(shifts))), np.where(held, 1.0, LOOSE)
    return smooth_corrections(wanted, np.zeros_like(wanted), frames, known, SMOOTH_S * fps, weights)


def _runs(flags: np.ndarray) -> list[np.ndarray]:
    """Runs of True as arrays of indices."""
    found = np.flatnonzero(flags)
    return [run for run in np.split(found, np.flatnonzero(np.diff(found) > 1) + 1) if len(run)]


def _legs_of(pose: SkeletonPose, feet: Feet, known: np.ndarray) -> dict[int, _Leg]:
    """The legs that have a joint to turn, by body group."""
    skeleton = pose.skeleton
    prior = turn_prior(pose.rows(np.flatnonzero(known)).local, OPEN_RAD).double().numpy()
    local, rotations, heads = (part.double().numpy() for part in (pose.local, pose.rotations, pose.heads))
    offsets = pose.offsets.expand(len(pose), -1, 3).double().numpy()
    legs = {}
    groups = dict.fromkeys(int(group) for group in feet.groups)
    for group, chain, (_, _, ankle) in zip(groups, feet.chains, limb_joints(skeleton, feet), strict=True):
        below = list(chain[: chain.index(ankle) + 1])
        joints = below[:-1]
        if not joints:
            continue
        above = rotations[:, int(skeleton.parents[joints[0]])]
        limb = Limb(local[:, joints], above, heads[:, joints[0]], offsets[:, below[1:]])
        legs[group] = _Leg(int(ankle), joints, limb, prior[joints])
    return legs


def _eased(legs: list[_Leg], wanted: list[_Wanted], known: np.ndarray, fps: float) -> list[np.ndarray]:
    """Turns (T, n, 3) of each leg that hold its foot as far as the leg stays calm.

    A stand near which a leg turns or accelerates too much keeps `LET_GO` of its shift, after `ROUNDS` rounds nothing.
    """
    still = [np.zeros(leg.limb.offsets.shape) for leg in legs]
    loose = [_motion_of(leg, turns, fps) for leg, turns in zip(legs, still, strict=True)]
    limits = _limits(np.max(loose, axis=0), known, fps)
    return [_eased_leg(leg, want, limits, known, fps) for leg, want in zip(legs, wanted, strict=True)]


def _eased_leg(leg: _Leg, wanted: _Wanted, limits: np.ndarray, known: np.ndarray, fps: float) -> np.ndarray:
    runs = _runs(wanted.held)
    trusts, floor_trust = np.ones(len(runs)), np.ones(len(known))
    gaps = _runs(~known)
    while trusts.any() or floor_trust[~known].any():
        trust = np.zeros(len(known))
        for run, kept in zip(runs, trusts, strict=True):
            trust[run] = kept
        shifts = wanted.path(trust, floor_trust, known, fps)
        turns = solve_limb(leg.limb, shifts, leg.prior, known, noise_m=NOISE_M, span=SMOOTH_S * fps)
        over = np.flatnonzero((_motion_of(leg, turns, fps) > limits).any(0))
        if not len(over):
            return turns
        near = np.array([np.abs(run[:, None] - over).min() <= NEAR_S * fps for run in runs], bool)
        if (trusts[near] > 0).any():
            trusts[near] = _less(trusts[near])
            continue
        # No stand is left there: the floor is let go, and after that, far stands.
        touched = [gap for gap in gaps if ((over >= gap[0] - 1) & (over <= gap[-1] + 1)).any()]
        touched = [gap for gap in touched if floor_trust[gap].any()]
        for gap in touched:
            floor_trust[gap] = _less(floor_trust[gap])
        if not touched:
            trusts = _less(trusts)
            floor_trust = floor_trust if trusts.any() else _less(floor_trust)
    return np.zeros(leg.limb.offsets.shape)


def _less(trusts: np.ndarray) -> np.ndarray:
    """Trusts after one more round."""
    return np.where(trusts * LET_GO > LET_GO**ROUNDS, trusts * LET_GO, 0.0)


def _motion_of(leg: _Leg, turns: np.ndarray, fps: float) -> np.ndarray:
    """(2, T) how fast the leg turns, degrees a second, and how much it accelerates, metres a second squared.

    Of the joint that does so most; the faster of the turns from and to a frame. The hip, which stays, is left out.
    """
    rotations, places, end = leg.limb.turned(turns)
    cosines = np.abs((rotations[1:] * rotations[:-1]).sum(-1))
    speeds = fps * np.degrees(2 * np.arccos(np.clip(cosines, 0, 1))).max(-1)
    out = np.zeros((2, len(turns)))
    out[0, 1:], out[0, :-1] = speeds, np.maximum(out[0, :-1], speeds)
    moving = np.concatenate([places[:, 1:], end[:, None]], axis=1)
    out[1, 1:-1] = fps**2 * np.linalg.norm(np.diff(moving, n=2, axis=0), axis=-1).max(-1)
    return out


def _limits(loose: np.ndarray, known: np.ndarray, fps: float) -> np.ndarray:
    """(2, T) limits of `_motion_of`: the legs' own maximum in each gap and at its keys, but at least that of a calm
    motion, times `MORE`. loose: (2, T) `_motion_of` without turns."""
    limits = np.maximum(loose, np.array([[CALM_DEG_PER_S], [CALM_MPS2]]))
    for gap in _runs(~known):
        around = slice(max(gap[0] - 1, 0), gap[-1] + 2)
        limits[:, around] = np.maximum(limits[:, around], loose[:, around].max(1, keepdims=True))
    return limits * MORE


def _with_legs_turned(pose: SkeletonPose, legs: list[_Leg], turns: list[np.ndarray]) -> SkeletonPose:
    """The pose with the legs' joints turned and the feet's directions in the world kept."""
    added = torch.zeros(len(pose), len(pose.skeleton.parents), 3)
    for leg, turn in zip(legs, turns, strict=True):
        added[:, leg.joints] = torch.as_tensor(turn, dtype=torch.float32)
    moved = pose.corrected(added, torch.zeros(len(pose), 3))
    kept = _with_feet_kept(moved, pose.rotations, [leg.ankle for leg in legs])
    return moved.with_local(kept, moved.roots, moved.offsets)


def _with_feet_kept(pose: SkeletonPose, rotations: Tensor, tops: list[int]) -> Tensor:
    """Local rotations in which the feet have their old directions in the world."""
    out = pose.local.clone()
    for joint in tops:
        above = pose.rotations[:, int(pose.skeleton.parents[joint])]
        out[:, joint] = multiply(conjugate(above), rotations[:, joint])
    return out
