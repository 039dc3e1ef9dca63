"""Where the feet stand, and how far they slide while they do: from joint positions alone, on any rig.

Definition. Each leg has one or two **contact joints**: the last joint of its main chain (the toes, or the ankle where
a rig has no more), and its parent where the bone between them is a foot (a twentieth to a third of the leg long).
A contact joint **stands** in a frame in which it is low and slow:

- low: at most `HEIGHT_SHARE` of the leg above its own floor level, which is the `LEVEL_PERCENTILE`-th percentile of
  its heights in the known frames, left and right together (an ankle's level lies above the toes');
- slow: it moves at most `SPEED_SHARE` legs a second, up and down included;
- for `LEAST_S` seconds at least; shorter interruptions than that are filled in.

**Foot skate** is the mean horizontal speed of the joints that stand, in metres a second, over pairs of neighbouring
frames in both of which they stand. Speed is part of what standing is, so that a foot that slides as fast as it walks
counts as moving: to compare two motions, take the contacts of one of them (the truth, where there is one) for both;
to judge one motion alone, use `low_feet`, which asks for the height only and is stricter there.

The floor is flat: on stairs and slopes feet above the lowest level count as lifted, so that nothing is said of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Skeleton
from stages.shared.kinematics.quantiles import percentile

LEGS = (BODY_GROUPS.index("left_leg"), BODY_GROUPS.index("right_leg"))
HEIGHT_SHARE = 0.06
SPEED_SHARE = 0.35
LOW_SHARE = 0.02
LEVEL_PERCENTILE = 5.0
LEAST_S = 0.1
FOOT_SHARE = (0.05, 0.35)  # of the leg's length, what a foot bone may measure

LEAST_SHARE = 1e-3  # of the leg's length: a shorter bone has no length


@dataclass(frozen=True)
class Feet:
    """The contact joints of a skeleton.

    joints:   (F,) int64, index into the skeleton.
    groups:   (F,) int64, the leg's body group.
    is_end:   (F,) bool, True for the last joint of its leg.
    chains:   per leg, in the order of `LEGS`, its main chain from the hip to the last joint.
    leg_m:    length of a leg from the hip to the last joint, metres, mean of both.
    """

    joints: np.ndarray
    groups: np.ndarray
    is_end: np.ndarray
    chains: tuple[tuple[int, ...], ...]
    leg_m: float


def find_feet(skeleton: Skeleton) -> Feet:
    """The contact joints of a skeleton with two legs. Raises InputError where a leg has no chain of bones."""
    chains = tuple(_leg_chain(skeleton, group) for group in LEGS)
    if not all(chains):
        raise InputError("The skeleton has no two legs, so no foot can stand.", "Look at it with pumps inspect.")
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    leg = float(np.mean([lengths[list(chain[1:])].sum() for chain in chains]))
    joints: list[int] = []
    groups: list[int] = []
    for group, chain in zip(LEGS, chains, strict=True):
        last = chain[-1]
        foot = leg > 0 and FOOT_SHARE[0] <= lengths[last] / leg <= FOOT_SHARE[1] and len(chain) >= 3
        found = [*chain[-2:]] if foot else [last]
        joints += found
        groups += [group] * len(found)
    ends = np.isin(joints, [chain[-1] for chain in chains])
    return Feet(np.array(joints), np.array(groups), ends, chains, leg)


def has_feet(skeleton: Skeleton) -> bool:
    """Whether `find_feet` finds any."""
    return all(_leg_chain(skeleton, group) for group in LEGS)


def limb_joints(skeleton: Skeleton, feet: Feet) -> np.ndarray:
    """(2, 3) hip, knee and ankle of each leg, in the order of `LEGS`, index into the skeleton.

    The ankle is the leg's first contact joint. The knee is the joint above it that parts the leg most evenly, so that
    a twist joint, or a joint of a hip of several joints, is not taken for it. A leg with no joint between hip and
    ankle has its hip twice.
    """
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    found = np.empty((len(feet.chains), 3), np.int64)
    for leg, chain in enumerate(feet.chains):
        ankle = next(place for place, joint in enumerate(chain) if joint in feet.joints)
        down = np.concatenate([[0.0], np.cumsum(lengths[list(chain[1 : ankle + 1])])])
        inner = range(1, ankle)
        knee = max(inner, key=lambda place, down=down: min(down[place], down[-1] - down[place]), default=0)
        hip = 1 if lengths[chain[0]] < LEAST_SHARE * down[-1] and knee > 1 else 0
        found[leg] = chain[hip], chain[knee], chain[ankle]
    return found


def _leg_chain(skeleton: Skeleton, group: int) -> tuple[int, ...]:
    """Sampled joints of a leg from the hip down, or all of its joints where none is sampled."""
    members = np.flatnonzero((skeleton.groups == group) & skeleton.sampled)
    if len(members) == 0:
        members = np.flatnonzero(skeleton.groups == group)
    if len(members) == 0:
        return ()
    chain = [int(members[-1])]  # parents come before children: the last sampled joint is the chain's end
    while skeleton.groups[skeleton.parents[chain[-1]]] == group:
        chain.append(int(skeleton.parents[chain[-1]]))
    return tuple(reversed(chain))


def floor_levels(positions: np.ndarray, feet: Feet, known: np.ndarray | None = None) -> np.ndarray:
    """(F,) height at which each contact joint stands on the floor, metres.

    Args:
        positions: (T, J, 3) metres, Y up.
        known: (T,) bool, the frames to go by; None for all.
    """
    rows = positions if known is None else positions[np.asarray(known, bool)]
    heights = rows[:, feet.joints, 1]
    levels = np.empty(len(feet.joints))
    for end in (False, True):
        alike = np.flatnonzero(feet.is_end == end)
        if len(alike):
            levels[alike] = percentile(heights[:, alike].reshape(-1), LEVEL_PERCENTILE)
    return levels


def contact_speeds(positions: np.ndarray, feet: Feet, fps: float) -> np.ndarray:
    """(T, F) speed of the contact joints, metres a second: the smaller of that before and after a frame.

    The smaller, so that the last frame before a foot lifts still counts as standing.
    """
    steps = np.linalg.norm(np.diff(positions[:, feet.joints].astype(np.float64), axis=0), axis=-1) * fps
    if len(steps) == 0:
        return np.zeros((len(positions), len(feet.joints)))
    return np.minimum(np.concatenate([steps[:1], steps]), np.concatenate([steps, steps[-1:]]))


def detect_contacts(
    positions: np.ndarray,
    feet: Feet,
    fps: float,
    *,
    known: np.ndarray | None = None,
    levels: np.ndarray | None = None,
    slow_mps: np.ndarray | None = None,
) -> np.ndarray:
    """Which contact joints stand in which frames, (T, F) bool, by the definition above.

    Args:
        positions: (T, J, 3) joints in the world, metres, Y up.
        known: (T,) bool, the frames that the floor's level is taken from; None for all.
        levels: (F,) the floor's levels, where they are known already.
        slow_mps: (T, F) the speed up to which a joint is slow, where it is not `SPEED_SHARE` legs a second.
    """
    levels = floor_levels(positions, feet, known) if levels is None else levels
    slow_mps = np.array(SPEED_SHARE * feet.leg_m) if slow_mps is None else slow_mps
    low = positions[:, feet.joints, 1] - levels <= HEIGHT_SHARE * feet.leg_m
    slow = contact_speeds(positions, feet, fps) <= slow_mps
    least = max(round(LEAST_S * fps), 1)
    filled = ~_long_runs(~(low & slow), least)
    return _long_runs(filled & low, least)


def low_feet(positions: np.ndarray, feet: Feet, levels: np.ndarray | None = None) -> np.ndarray:
    """(T, F) bool: contact joints within `LOW_SHARE` of the leg of their floor level, however fast they move."""
    levels = floor_levels(positions, feet) if levels is None else levels
    return positions[:, feet.joints, 1] - levels <= LOW_SHARE * feet.leg_m


def foot_skate_mps(positions: np.ndarray, contacts: np.ndarray, feet: Feet, fps: float) -> float:
    """Mean horizontal speed of the joints that stand, metres a second; NaN where none does.

    Args:
        positions: (T, J, 3) metres. contacts: (T, F) bool, of this motion or of the one that it should be.
    """
    both = contacts[1:] & contacts[:-1]
    if not both.any():
        return float("nan")
    steps = np.diff(positions[:, feet.joints][..., [0, 2]].astype(np.float64), axis=0)
    return float(np.linalg.norm(steps, axis=-1)[both].mean() * fps)


def _long_runs(flags: np.ndarray, least: int) -> np.ndarray:
    """Flags (T, F) without the runs of True that are shorter than `least`; runs at the ends may be cut, and stay."""
    if not len(flags):
        return flags.copy()
    columns = np.ascontiguousarray(flags.T)  # all columns in a row; each begins a run
    begins = np.ones(columns.shape, bool)
    np.not_equal(columns[:, 1:], columns[:, :-1], out=begins[:, 1:])
    starts = np.flatnonzero(begins)
    lengths = np.diff(starts, append=columns.size)
    at_an_end = (starts % len(flags) == 0) | ((starts + lengths) % len(flags) == 0)
    short = np.repeat((lengths < least) & ~at_an_end, lengths)
    return np.ascontiguousarray((columns & ~short.reshape(columns.shape)).T)


def and_below(parents: np.ndarray, joints: Iterable[int], but: Iterable[int] = ()) -> list[int]:
    """Joints and all joints below them, parents first, without those of `but` and the joints below those.

    Args:
        parents: (J,) index of each joint's parent, smaller than its own; -1 at the top.
    """
    found, left_out = set(joints), set(but)
    for joint, parent in enumerate(parents):
        if int(parent) in found and joint not in left_out:
            found.add(joint)
    return sorted(found)
