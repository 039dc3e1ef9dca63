"""Feet that stand stay where they stand: a clean-up of filled frames that moves legs and nothing else.

While a contact joint stands (`stages.shared.inference.standing_feet`), its foot is shifted as a whole to one place:
through the keys' own places where keys are among the frames, else to the middle of its path at the height at which
it stands in the keys. Where neither foot stands although the body does not fly, the lower foot comes down. The
shift begins and ends smoothly and is 0 at every key. No foot comes lower than the lowest foot in the known frames.
The leg's joints above the foot are solved for it over time (`stages.shared.solve.limb_solve`). The foot keeps its
direction and the pelvis keeps its place. Hips and knees turn about the axes about which they turn in the keys, so
that no knee flips.

Holding a foot never makes a pop worse (`stages.shared.inference.pop_limits`). The shift is the nearest to the wanted
one with which no part of the foot accelerates more than it may (`stages.shared.solve.bounded_path`). Where the leg
above the foot still turns or accelerates too much, its shift is reduced step by step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from scipy.ndimage import maximum_filter1d

from stages.shared.inference.pop_limits import ROUNDING, PopLimits, Steps, without_pops
from stages.shared.inference.standing_feet import held_shifts, lowered_feet, standing_feet
from stages.shared.kinematics.foot_contacts import Feet, and_below, find_feet, limb_joints
from stages.shared.kinematics.rotations import multiply
from stages.shared.kinematics.runs import runs_of
from stages.shared.solve.bounded_path import bounded_shift
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.limb_solve import Limb, solve_limb
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.solve.smoothing import smooth_corrections

SMOOTH_S, LOOSE = 0.06, 0.005
NOISE_M = 0.004  # how closely a foot meets its place
OPEN_RAD = 0.5  # how far a leg's joint may turn about an axis about which the keys do not turn it
FLOOR_ROUNDS = 3
LET_GO, ROUNDS = 0.4, 3  # share of a shift that a round keeps; rounds until it is 0
# A foot's path keeps to a share of the limit of accelerations, a smaller one where the solved leg exceeds its limits.
PATH_SHARE, TIGHTEN, TIGHT_LEAST = 0.9, 0.4, 0.15
TIGHTEN_S = 0.1  # around a frame in which it does
FIRST, AGAIN = 6, 2  # iterations of the first solve of a leg, and of those that start from the one before
PIECE_S = 4.0  # a clip is solved in pieces about so long
NEAR_S = 0.2  # a shift is near to a frame up to so many seconds away


def lock_feet(pose: SkeletonPose, known: np.ndarray, fps: float, stiff: np.ndarray | None = None) -> SkeletonPose:
    """Hold standing feet in the frames that are not known.

    A leg without a joint above its first contact joint cannot be moved, and stays as it is. No measured joint turns
    further in a frame, or accelerates more, than one of the given pose does within two seconds (`PopLimits`).

    Args:
        pose: T frames, filled, `fps` a second. known: (T,) bool; known frames come back value for value.
        stiff: (T, J) bool, joints that must not turn in their parents; a leg with such a joint stays as it is there.

    Raises: InputError where the skeleton has no two legs.
    """
    feet = find_feet(pose.skeleton)
    places = pose.heads.numpy()
    contacts = standing_feet(places, feet, fps, known)
    legs = _legs_of(pose, feet, known)
    shifts = held_shifts(places, contacts, feet, known)
    lowered = lowered_feet(places, contacts, feet, pose.skeleton.root, known, fps)
    wanted = [_wanted_shift(places, shifts, contacts, lowered, feet, leg.group, known) for leg in legs]
    if known.all() or not any(
        each.held.any() or each.lower.any() or each.heights.min() < each.floors.min() for each in wanted
    ):
        return pose
    limits = PopLimits.of(Steps.of_pose(pose), known, fps)
    turns = [np.zeros(leg.limb.offsets.shape) for leg in legs]
    still = [known if stiff is None else known | stiff[:, leg.members(pose.skeleton.parents)].any(1) for leg in legs]
    shifts = [np.zeros(want.shifts.shape) for want in wanted]
    for own, around in _pieces(known, PIECE_S * fps):
        fixed = np.arange(around.start, around.stop) < own.start  # solved with the piece before
        for leg, want, turn, shift, stays in zip(legs, wanted, turns, shifts, still, strict=True):
            if stays[around].all():
                continue
            piece = _Piece(leg.rows(around), want.rows(around), stays[around], fixed, shift[around], turn[around])
            shift[around], turn[around] = _calm(piece, limits.rows(around), fps)
    return without_pops(pose, _with_legs_turned(pose, legs, turns, known), known, fps)


@dataclass(frozen=True)
class _Leg:
    """A leg over all T frames, and what it does by itself.

    group:  its body group.
    joints: (n,) from the hip to the joint above the ankle, index into the skeleton.
    ankle:  its first contact joint, index into the skeleton.
    foot:   (T, m, 3) the ankle and what hangs on it, metres.
    prior:  (n, 3, 3) of the joints' turns.
    """

    group: int
    joints: list[int]
    ankle: int
    limb: Limb
    foot: np.ndarray
    prior: np.ndarray

    def members(self, parents: np.ndarray) -> list[int]:
        """Its joints, the ankle and what hangs on them."""
        return and_below(parents, [self.joints[0]])

    def rows(self, rows: slice) -> _Leg:
        """Some of the frames."""
        return replace(self, limb=self.limb.rows(rows), foot=self.foot[rows])

    def steps(self, turns: np.ndarray) -> Steps:
        """How far the leg's joints turn and bend their paths with turns (T, n, 3) added; its hip stays."""
        rotations, places, end = self.limb.turned(turns)
        foot = self.foot + (end - self.limb.by_itself[2])[:, None]
        return Steps.of(rotations, np.concatenate([places[:, 1:], foot], axis=1))


def _legs_of(pose: SkeletonPose, feet: Feet, known: np.ndarray) -> list[_Leg]:
    """The legs that have a joint to turn."""
    skeleton = pose.skeleton
    prior = turn_prior(pose.rows(np.flatnonzero(known)).local, OPEN_RAD).double().numpy()
    local, rotations, heads = (part.double().numpy() for part in (pose.local, pose.rotations, pose.heads))
    offsets = pose.offsets.expand(len(pose), -1, 3).double().numpy()
    legs = []
    groups = dict.fromkeys(int(group) for group in feet.groups)
    for group, chain, (_, _, ankle) in zip(groups, feet.chains, limb_joints(skeleton, feet), strict=True):
        below = list(chain[: chain.index(ankle) + 1])
        joints = below[:-1]
        if not joints:
            continue
        above = rotations[:, int(skeleton.parents[joints[0]])]
        limb = Limb(local[:, joints], above, heads[:, joints[0]], offsets[:, below[1:]])
        foot = heads[:, and_below(skeleton.parents, [int(ankle)])]
        legs.append(_Leg(group, joints, int(ankle), limb, foot, prior[joints]))
    return legs


@dataclass(frozen=True)
class _Wanted:
    """What is wanted of one leg's foot over T frames.

    shifts:  (T, 3) metres, in the frames in which it is held, elsewhere 0.
    held:    (T,) bool.
    lower:   (T,) metres, at most 0: added to the height of a foot that floats.
    heights: (T, M) of its contact joints, metres.
    floors:  (M,) the lowest that a contact joint of each kind comes in a known frame.
    """

    shifts: np.ndarray
    held: np.ndarray
    lower: np.ndarray
    heights: np.ndarray
    floors: np.ndarray

    def rows(self, rows: slice) -> _Wanted:
        """Some of the frames."""
        return _Wanted(self.shifts[rows], self.held[rows], self.lower[rows], self.heights[rows], self.floors)

    @cached_property
    def stands(self) -> list[np.ndarray]:
        """Runs of frames in which the foot is held."""
        return runs_of(self.held)

    def path(self, trust: np.ndarray, floor_trust: np.ndarray, known: np.ndarray, fps: float) -> np.ndarray:
        """(T, 3) shifts that come and go smoothly: of stands and out of the floor, each times its trust (T,)."""
        path = _smooth(trust[:, None] * self.shifts, self.held, known, fps)
        wanted = np.where(known, 0.0, self.lower)[:, None]
        lift = _smooth(wanted, wanted[:, 0] < 0, known, fps)
        for _ in range(FLOOR_ROUNDS):  # what the smoothing leaves below the floor is asked for again
            sunk = (self.floors - (self.heights + path[:, 1:2] + lift)).max(1, keepdims=True)
            wanted = wanted + np.where(known[:, None], 0.0, np.maximum(sunk, 0.0))
            lift = _smooth(wanted, wanted[:, 0] != 0, known, fps)
        path[:, 1:2] += _smooth(floor_trust[:, None] * wanted, wanted[:, 0] != 0, known, fps)
        return path


def _wanted_shift(
    places: np.ndarray,
    shifts: np.ndarray,
    contacts: np.ndarray,
    lowered: np.ndarray,
    feet: Feet,
    group: int,
    known: np.ndarray,
) -> _Wanted:
    """What is wanted of the foot of the leg of this body group."""
    heights = places[:, feet.joints, 1]
    lowest = np.array([heights[known][:, feet.is_end == end].min() for end in feet.is_end])
    members = np.flatnonzero(feet.groups == group)
    held = contacts[:, members]
    own = (shifts[:, members] * held[..., None]).sum(1) / np.maximum(held.sum(1, keepdims=True), 1)
    lower = lowered[:, members].min(1)
    return _Wanted(own, np.asarray(held.any(1)), lower, heights[:, members], lowest[members])


def _smooth(shifts: np.ndarray, held: np.ndarray, known: np.ndarray, fps: float) -> np.ndarray:
    """Shifts (T, 3) that follow those of the held frames, die away between them, and are nothing at keys.

    A foot that stops to stand, or that changes from heel to toe, must not jump: the path is near to the
    wanted one and bends little (Whittaker's smoother: squares of second differences). `SMOOTH_S` sets how much it may
    bend; frames in which the foot is not held have the weight `LOOSE`.
    """
    wanted = np.where(held[:, None], shifts, 0.0)
    frames, weights = np.arange(float(len(shifts))), np.where(held, 1.0, LOOSE)
    return smooth_corrections(wanted, np.zeros_like(wanted), frames, known, SMOOTH_S * fps, weights)


def _pieces(known: np.ndarray, frames: float) -> list[tuple[slice, slice]]:
    """Pieces of a clip, about so many frames long, and what each is solved with: one more gap on either side.

    Pieces begin and end at keys. A leg that lets go in one place is solved again in one piece alone.
    """
    # Gap g lies between borders[g] and borders[g + 1]; the first and the last border are the clip's ends.
    borders = [0, *(int(gap[0]) - 1 for gap in runs_of(~known) if gap[0] > 1), len(known) - 1]
    firsts = [0]
    for place, border in enumerate(borders[:-1]):
        if border - borders[firsts[-1]] >= frames:
            firsts.append(place)
    pieces = []
    for first, last in pairwise([*firsts, len(borders) - 1]):
        around = slice(borders[max(first - 1, 0)], borders[min(last + 1, len(borders) - 1)] + 1)
        pieces.append((slice(borders[first], borders[last] + 1), around))
    return pieces


@dataclass(frozen=True)
class _Piece:
    """A leg in a piece of a clip.

    known: (T,) bool. fixed: (T,) bool, frames that keep their shifts (T, 3) and turns (T, n, 3), as keys do.
    """

    leg: _Leg
    wanted: _Wanted
    known: np.ndarray
    fixed: np.ndarray
    shifts: np.ndarray
    turns: np.ndarray


def _calm(piece: _Piece, limits: PopLimits, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Shifts (T, 3) of a foot and turns (T, n, 3) of its leg that hold it as far as its steps stay within the limits.

    Where they do not, the foot's path may bend less (`TIGHTEN`). Where that does not suffice, a stand near keeps
    `LET_GO` of its shift, after `ROUNDS` rounds nothing. Where no stand is left near, what is wanted of heights
    in the gap is reduced likewise; and where nothing is left near, the leg stays as it is.
    """
    leg, wanted, known, fixed = piece.leg, piece.wanted, piece.known, piece.fixed
    gaps, span, frames = runs_of(~known), SMOOTH_S * fps, len(known)
    no_shifts = np.where(fixed[:, None], piece.shifts, 0.0)
    no_turns = np.where(fixed[:, None, None], piece.turns, 0.0)
    pinned = known | fixed
    limits = limits.raised_to(leg.steps(np.zeros(piece.turns.shape)))
    weights, shares = np.where(wanted.held, 1.0, LOOSE), np.full(frames, PATH_SHARE)
    trusts, floor_trusts, turns = np.ones(len(wanted.stands)), np.ones(len(gaps)), no_turns
    iterations = FIRST
    while trusts.any() or floor_trusts.any():
        trust, floor_trust = _spread(wanted.stands, trusts, frames), _spread(gaps, floor_trusts, frames)
        path = np.where(fixed[:, None], piece.shifts, wanted.path(trust, floor_trust, known, fps))
        shifts = bounded_shift(path, leg.foot, shares[1:-1] * limits.bends, pinned, weights, span=span)
        turns = solve_limb(
            leg.limb, shifts, leg.prior, pinned, noise_m=NOISE_M, span=span, start=turns, iterations=iterations
        )
        iterations = AGAIN
        over = limits.broken_frames(leg.steps(turns), known, ROUNDING / 10)
        over = over[over >= max(fixed.sum() - 1, 0)]
        if not len(over):
            return shifts, turns
        is_over = np.isin(np.arange(frames), over)
        tighten = np.asarray(maximum_filter1d(is_over, 2 * round(TIGHTEN_S * fps) + 1), bool)
        near, gaps_near = _near(wanted.stands, over, NEAR_S * fps), _near(gaps, over, 1)
        if (shares[tighten] > TIGHT_LEAST).any():
            shares[tighten] *= TIGHTEN
        elif (trusts[near] > 0).any():
            trusts[near] = _less(trusts[near])
        elif (floor_trusts[gaps_near] > 0).any():
            floor_trusts[gaps_near] = _less(floor_trusts[gaps_near])
        else:
            break
    return no_shifts, no_turns


def _spread(runs: list[np.ndarray], values: np.ndarray, frames: int) -> np.ndarray:
    """(T,) each run's value in its frames, 0 elsewhere."""
    out = np.zeros(frames)
    for run, value in zip(runs, values, strict=True):
        out[run] = value
    return out


def _near(runs: list[np.ndarray], frames: np.ndarray, most: float) -> np.ndarray:
    """(R,) bool: runs of which a frame is at most so many frames from one of `frames`."""
    return np.array([np.maximum(run[0] - frames, frames - run[-1]).min() <= most for run in runs], bool)


def _less(trusts: np.ndarray) -> np.ndarray:
    """Trusts after one more round."""
    return np.where(trusts * LET_GO > LET_GO**ROUNDS, trusts * LET_GO, 0.0)


def _with_legs_turned(
    pose: SkeletonPose, legs: list[_Leg], turns: list[np.ndarray], known: np.ndarray
) -> SkeletonPose:
    """The pose with the legs' joints turned in its gaps. The feet and all else keep their directions in the world,
    but what hangs on a leg beside its chain turns with it."""
    parents = pose.skeleton.parents
    rotations = pose.rotations.clone()
    for leg, turn in zip(legs, turns, strict=True):
        rotations[:, leg.joints] = torch.as_tensor(leg.limb.turned(turn)[0], dtype=torch.float32)
        for joint in and_below(parents, leg.joints, [leg.ankle]):
            if joint not in leg.joints:
                rotations[:, joint] = multiply(rotations[:, int(parents[joint])], pose.local[:, joint])
    gaps = np.flatnonzero(~known)
    return pose.with_rows(gaps, replace(pose, held=rotations, is_global=True).rows(gaps))
