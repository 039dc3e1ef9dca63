"""Feet that stand stay where they stand: a clean-up of filled frames that moves legs and nothing else.

While a contact joint stands (`stages.shared.kinematics.foot_contacts`), its foot is shifted as a whole to one place:
through the keys' own places where keys are among the frames, else to the mean. The shift comes and goes smoothly, is
nothing at every key; and no foot comes lower than the lowest does in the known frames. The leg's joints above the
foot are solved for it; the foot keeps its direction, the pelvis its place. Hips and knees turn about the axes about
which they turn in the keys, so that no knee flips.
"""

from __future__ import annotations

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
)
from stages.shared.kinematics.rotations import conjugate, multiply
from stages.shared.solve.binding import Binding
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.solve.smoothing import smooth_corrections
from stages.shared.solve.solving import SolveOptions, solve_pose

SMOOTH_S, LOOSE = 0.06, 0.005
# A filled foot is slow up to this share of its own fastest within so many seconds, at most so many legs a second.
SLOW_SHARE, FASTEST_WITHIN_S, SLOW_AT_MOST = 0.7, 1.0, 1.5
FURTHEST_SHARE = 0.25  # of the leg: a foot that would have to be moved further was not a standing one
LEG = SolveOptions(point_noise_m=0.005, huber_m=1.0, turn_prior_rad=0.5, shift_prior_m=1e-4, iterations=12)
STILL_RAD = 1e-4


def lock_feet(pose: SkeletonPose, known: np.ndarray, fps: float) -> SkeletonPose:
    """Hold standing feet in the frames that are not known.

    Args:
        pose: T frames, filled, `fps` a second. known: (T,) bool; known frames come back value for value.

    Raises: InputError where the skeleton has no two legs.
    """
    feet = find_feet(pose.skeleton)
    places = pose.heads.numpy()
    contacts = standing_feet(places, feet, fps, known)
    gaps = np.flatnonzero(~known)
    shifts = _foot_shifts(places, contacts, feet, known, fps)
    if len(gaps) == 0 or not np.any(shifts):
        return pose
    keys = pose.rows(np.flatnonzero(known))
    return pose.with_rows(gaps, _with_feet_moved(pose.rows(gaps).by_local(), keys, feet, shifts[gaps]))


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


def _foot_shifts(places: np.ndarray, contacts: np.ndarray, feet: Feet, known: np.ndarray, fps: float) -> np.ndarray:
    """(T, 2, 3) how far each leg's foot is to be moved, metres, in the order of `LEGS`."""
    legs = np.unique(feet.groups)
    shifts = np.zeros((len(places), len(legs), 3))
    for leg, group in enumerate(legs):
        members = np.flatnonzero(feet.groups == group)
        wanted = np.zeros((len(places), len(members), 3))
        for column, member in enumerate(members):
            wanted[:, column] = _held(places[:, feet.joints[member]], contacts[:, member], known)
        held = contacts[:, members]
        count = held.sum(1, keepdims=True)
        own = (wanted * held[..., None]).sum(1) / np.maximum(count, 1)
        shifts[:, leg] = _smooth(own, np.asarray(held.any(1)), known, fps)
        shifts[:, leg, 1] += _sunk(places[:, feet.joints, 1], shifts[:, leg, 1], members, feet, known)
    return shifts


def _sunk(heights: np.ndarray, raised: np.ndarray, members: np.ndarray, feet: Feet, known: np.ndarray) -> np.ndarray:
    """(T,) how far a leg's foot, raised so far (T,), lies below the floor in the frames that are not known.

    Args:
        heights: (T, F) of all contact joints; the floor is the lowest that one of its kind comes in a known frame.
        members: the leg's contact joints.
    """
    deepest = np.zeros(len(heights))
    for member in members:
        alike = feet.is_end == feet.is_end[member]
        floor = heights[known][:, alike].min()
        deepest = np.maximum(deepest, floor - (heights[:, member] + raised))
    return np.where(known, 0.0, deepest)


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


def _with_feet_moved(pose: SkeletonPose, keys: SkeletonPose, feet: Feet, shifts: np.ndarray) -> SkeletonPose:
    """The pose with the legs turned so that the feet come where they are wanted, the feet's directions kept."""
    skeleton = pose.skeleton
    heads, rotations = pose.world()
    tops = [next(j for j in chain if j in feet.joints) for chain in feet.chains]
    count = len(tops)
    binding = Binding(torch.tensor(tops), torch.zeros(count, 3), torch.ones(count), torch.zeros(count))
    targets = heads[:, tops] + torch.as_tensor(shifts, dtype=heads.dtype)
    prior = turn_prior(keys.local, LEG.turn_prior_rad)
    prior[skeleton.root] = torch.eye(3) * STILL_RAD**-2
    found = solve_pose(targets, binding, *pose.parts, skeleton.parents, skeleton.root, LEG, prior)
    active = torch.as_tensor(np.abs(shifts).sum((1, 2)) > 0)
    turns = torch.where(active[:, None, None], found.turns, torch.zeros_like(found.turns))
    turns[:, skeleton.root] = 0
    moved = pose.corrected(turns, torch.zeros_like(found.shifts))
    return moved.with_local(_with_feet_kept(moved, rotations, tops), moved.roots, moved.offsets)


def _with_feet_kept(pose: SkeletonPose, rotations: Tensor, tops: list[int]) -> Tensor:
    """Local rotations in which the feet have their old directions in the world."""
    out = pose.local.clone()
    for joint in tops:
        above = pose.rotations[:, int(pose.skeleton.parents[joint])]
        out[:, joint] = multiply(conjugate(above), rotations[:, joint])
    return out
