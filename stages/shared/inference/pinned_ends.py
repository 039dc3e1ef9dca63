"""Pinned end effectors: hands, feet or a head that stay at their places in the world while the body fills its gaps.

Each pinned end's limb is solved over time (`stages.shared.solve.limb_solve`). Where the limb alone does not reach
the place, the spine bends, and where that does not suffice, the pelvis moves and the legs are solved so that the
ankles stay. Ends keep their directions. Keys and joints that are given stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from data_schemas.errors import InputError
from data_schemas.skeleton import Skeleton
from stages.shared.inference.constraints.fixed import MOST_M, Fixed, PinnedEnd, place_of_keys
from stages.shared.inference.constraints.rig_parts import EndEffector, end_effector
from stages.shared.kinematics.foot_contacts import has_feet
from stages.shared.kinematics.rotations import multiply, rotate
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.limb_solve import Limb, solve_limb
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.solve.smoothing import smooth_corrections

NOISE_M = 0.0005  # how closely an end meets its place
OPEN_RAD = 0.5  # how far a joint may turn about an axis about which the keys do not turn it
SMOOTH_S, BODY_S = 0.08, 0.2  # over which a limb's and the body's corrections come and go
HELD, LOOSE = 1e6, 0.005  # weights of a shift in frames of the pin, and in others
CLOSE_M, REACHED_M = 0.0005, 0.002  # nearer than this an end is at its place; further, the body helps
ROUNDS = 6
SPINE_STIFFER = 10.0  # of the spine's joints beside the limb's


@dataclass(frozen=True)
class _Target:
    """A pin with the place (F, 3) of each of its frames, and with these places as drawn through the keys."""

    pin: PinnedEnd
    places: np.ndarray
    through_keys: np.ndarray

    def missed(self, pose: SkeletonPose) -> np.ndarray:
        """(F, 3) metres from the end to its place on the way through the keys."""
        return self.through_keys - _end_of(pose, self.pin)

    def off_m(self, pose: SkeletonPose) -> np.ndarray:
        """(F,) distance from the end to its place."""
        return np.linalg.norm(self.places - _end_of(pose, self.pin), axis=1)


def pin_ends(
    pose: SkeletonPose, fixed: Fixed, known: np.ndarray, fps: float
) -> tuple[SkeletonPose, dict[str, float]]:
    """The pose with pinned ends at their places, and how far each is from its place at most, metres.

    An end without a place stays in the middle of where keys of the range have it; without such keys at the mean of
    where it is.

    Args:
        pose: T frames, filled, `fps` a second. fixed: of T frames. known: (T,) bool.

    Raises: InputError for an end that stays further from its place than `MOST_M`.
    """
    targets = [_target_of(pin, pose, known) for pin in fixed.pins]
    if not targets:
        return pose, {}
    given = fixed.joints | known[:, None]
    free = ~known[:, None] & np.isnan(fixed.pelvis)
    for number in range(ROUNDS):
        for target in targets:
            pose = _limb_to_place(pose, target, given, known, fps)
        if max(_worst(target, pose) for target in targets) < CLOSE_M:
            break
        for target in targets:
            if _worst(target, pose) > REACHED_M and number > 0:
                pose = _with_spine(pose, target, given, known, fps)
        if number > 1 and max(_worst(target, pose) for target in targets) > REACHED_M:
            pose = _with_pelvis(pose, targets, given, free, known, fps)
    off = {target.pin.name: float(target.off_m(pose).max()) for target in targets}
    for target in targets:
        if off[target.pin.name] > MOST_M:
            distances = target.off_m(pose)
            worst = int(distances.argmax())
            raise InputError(
                f"{target.pin.name} cannot reach its place in frame {target.pin.frames[worst]}: it stays "
                f"{distances[worst] * 1000:.0f} mm away.",
                "Pin it nearer to the body, or for fewer frames, or free more of the body.",
            )
    return pose, off


def _target_of(pin: PinnedEnd, pose: SkeletonPose, known: np.ndarray) -> _Target:
    own = _end_of(pose, pin)
    is_key = known[pin.frames]
    places = pin.places
    if places is None:
        place = place_of_keys(own[is_key]) if is_key.any() else own.mean(axis=0)
        places = np.tile(place, (len(own), 1))
    through = places
    if is_key.any():
        off = (own - places)[is_key]
        through = places + np.stack(
            [np.interp(pin.frames, pin.frames[is_key], off[:, axis]) for axis in range(3)], axis=-1
        )
    return _Target(pin, places, through)


def _end_of(pose: SkeletonPose, pin: PinnedEnd) -> np.ndarray:
    return _point_of(pose, pin.end)[pin.frames]


def _point_of(pose: SkeletonPose, end: EndEffector) -> np.ndarray:
    """(T, 3) metres."""
    tail = torch.as_tensor(end.tail, dtype=torch.float32)
    turned = rotate(pose.rotations[:, end.joint], tail.expand(len(pose), 3))
    return (pose.heads[:, end.joint] + turned).double().cpu().numpy()


def _worst(target: _Target, pose: SkeletonPose) -> float:
    return float(np.linalg.norm(target.missed(pose), axis=1).max())


def _limb_to_place(
    pose: SkeletonPose, target: _Target, given: np.ndarray, known: np.ndarray, fps: float
) -> SkeletonPose:
    limb = list(target.pin.limb)
    shifts = _spread(target.missed(pose), target.pin.frames, known, SMOOTH_S * fps)
    return turn_chain(pose, limb, target.pin.end, shifts, given, known, SMOOTH_S * fps, np.ones(len(limb)))


def _with_spine(
    pose: SkeletonPose, target: _Target, given: np.ndarray, known: np.ndarray, fps: float
) -> SkeletonPose:
    """The pose with the spine bent towards a place; the rest of the body keeps its rotations in the parents."""
    skeleton, limb = pose.skeleton, list(target.pin.limb)
    spine = []
    above = int(skeleton.parents[limb[0]])
    while above >= 0 and above != skeleton.root:
        spine.append(above)
        above = int(skeleton.parents[above])
    if not spine:
        return pose
    shifts = _spread(target.missed(pose), target.pin.frames, known, BODY_S * fps)
    stiffness = np.r_[np.full(len(spine), SPINE_STIFFER), np.ones(len(limb))]
    return turn_chain(pose, [*spine[::-1], *limb], target.pin.end, shifts, given, known, BODY_S * fps, stiffness)


def _with_pelvis(
    pose: SkeletonPose, targets: list[_Target], given: np.ndarray, free: np.ndarray, known: np.ndarray, fps: float
) -> SkeletonPose:
    """The pose with the pelvis moved towards the places, as far as it is free, and ankles where they were."""
    skeleton = pose.skeleton
    missed, count = np.zeros((len(known), 3)), np.zeros((len(known), 1))
    for target in targets:
        missed[target.pin.frames] += target.missed(pose)
        count[target.pin.frames] += 1
    frames = np.flatnonzero(count[:, 0])
    shifts = _spread((missed / np.maximum(count, 1))[frames], frames, known, BODY_S * fps) * free
    moved = pose.corrected(torch.zeros_like(pose.heads), torch.as_tensor(shifts, dtype=torch.float32))
    moved = pose.with_rows(np.flatnonzero(~known), moved.rows(np.flatnonzero(~known)))
    if not has_feet(skeleton):
        return moved
    pinned = {target.pin.end.joint for target in targets}
    for foot in ("left_foot", "right_foot"):
        ankle = end_effector(skeleton, foot, foot)
        leg = ankle.limb(skeleton)
        if leg and ankle.joint not in pinned:
            back = _point_of(pose, ankle) - _point_of(moved, ankle)
            moved = turn_chain(moved, leg, ankle, back, given, known, SMOOTH_S * fps, np.ones(len(leg)))
    return moved


def _spread(missed: np.ndarray, frames: np.ndarray, known: np.ndarray, span: float) -> np.ndarray:
    """(T, 3) shifts that are those of some frames (F, 3) there, die away smoothly around them and are 0 at keys."""
    wanted, weights = np.zeros((len(known), 3)), np.full(len(known), LOOSE)
    wanted[frames], weights[frames] = missed, HELD
    times = np.arange(float(len(known)))
    return smooth_corrections(wanted, np.zeros_like(wanted), times, known, span, weights)


def turn_chain(
    pose: SkeletonPose,
    chain: list[int],
    end: EndEffector,
    shifts: np.ndarray,
    given: np.ndarray,
    known: np.ndarray,
    span: float,
    stiffness: np.ndarray,
) -> SkeletonPose:
    """The pose with a chain of joints turned so that its end is shifted.

    The end and what hangs on it keep their directions in the world, unless some of it is given in a frame; what
    hangs on the chain elsewhere turns with it.

    Args:
        chain: joints from the first on, of which the last moves the end. shifts: (T, 3) metres wanted of the end.
        given: (T, J) bool, joints that do not turn in their parents. known: (T,) bool, frames that stay.
        span: frames over which turns come and go. stiffness: (n,) factors on the joints' prior.
    """
    skeleton = pose.skeleton
    local, rotations, heads = (part.double().cpu().numpy() for part in (pose.local, pose.rotations, pose.heads))
    offsets = pose.offsets.expand(len(pose), -1, 3).double().cpu().numpy()
    prior = turn_prior(pose.rows(np.flatnonzero(known)).local, OPEN_RAD).double().cpu().numpy()
    last = offsets[:, end.joint] if end.is_head else np.tile(end.tail, (len(pose), 1))
    along = np.concatenate([offsets[:, chain[1:]], last[:, None]], axis=1)
    above, stiff = rotations[:, int(skeleton.parents[chain[0]])], prior[chain] * stiffness[:, None, None]
    limb = Limb(local[:, chain], above, heads[:, chain[0]], along)
    turns = solve_limb(limb, shifts, stiff, given[:, chain], noise_m=NOISE_M, span=span, iterations=20)
    made = pose.rotations.clone()
    made[:, chain] = torch.as_tensor(limb.turned(turns)[0], dtype=torch.float32)
    hanging = _below(skeleton, end.joint) if end.is_head else []
    # A joint is given in its parent: what hangs on the end turns with it in frames in which any of that is given.
    keeps = torch.as_tensor(~given[:, hanging].any(axis=1))[:, None]
    for joint in _below(skeleton, chain[0]):
        if joint in chain:
            continue
        turned = multiply(made[:, int(skeleton.parents[joint])], pose.local[:, joint])
        made[:, joint] = torch.where(keeps, made[:, joint], turned) if joint in hanging else turned
    gaps = np.flatnonzero(~known)
    return pose.with_rows(gaps, replace(pose, held=made, is_global=True).rows(gaps))


def _below(skeleton: Skeleton, joint: int) -> list[int]:
    """A joint and all below it, parents first."""
    found = {joint}
    for other, parent in enumerate(skeleton.parents):
        if int(parent) in found:
            found.add(other)
    return sorted(found)
