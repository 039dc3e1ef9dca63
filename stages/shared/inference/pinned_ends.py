"""Pinned end effectors: hands, feet or a head that stay at their places in the world while the body fills its gaps.

Each pinned end's limb is solved over time (`stages.shared.solve.limb_solve`). Where the limb alone does not reach
the place, the spine bends, and where that does not suffice, the pelvis moves and the legs are solved so that the
ankles stay. Ends keep their directions. Keys and joints that are given stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from data_schemas.errors import InputError
from stages.shared.inference.constraints.fixed import MOST_M, Fixed, PinnedEnd, place_of_keys
from stages.shared.inference.constraints.rig_parts import EndEffector, end_effector
from stages.shared.kinematics.foot_contacts import and_below, has_feet
from stages.shared.kinematics.rotations import multiply, rotate
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.limb_solve import Limb, solve_limb
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.solve.smoothing import smooth_corrections

NOISES_M = (0.02, 0.003, 0.0005)  # how closely an end meets its place, from a first solve to the last
ITERATIONS, LONGEST_STEP = 12, 0.3
OPEN_RAD = 0.5  # how far a joint may turn about an axis about which the keys do not turn it
LIMB_S, BODY_S = 0.08, 0.2  # over which the corrections of a limb and of the rest of the body come and go
AROUND_S = 1.0  # of the clip before and after the pins that may change
HELD, LOOSE = 1e6, 0.005  # weights of a shift in frames of the pin, and in others
CLOSE_M = 0.0005  # ends that are nearer to their places than this are there, and nothing more is done
REACHED_M = 0.002  # ends that are further away need the spine and the pelvis; later rounds end here
LEAN_M = 0.1  # further away than this, the spine bends in every other round only, after the pelvis has moved
DIVERGED = 3.0  # if the distance grows to so many times the smallest one, the next round starts from that pose again
ROUNDS, PATIENCE, BETTER = (
    14,
    4,
    0.9,
)  # most rounds, and most without a fall of the distance by a tenth
SPINE_STIFFER = 10.0  # how many times stiffer the spine's joints are than the limb's


@dataclass(frozen=True)
class _Held:
    """What stays while ends are moved.

    given: (T, J) bool, joints that do not turn in their parents. free: (T, 3) bool, axes on which the pelvis moves.
    known: (T,) bool, frames that stay. prior: (J, 3, 3) of the joints' turns. fps: frames a second.
    """

    given: np.ndarray
    free: np.ndarray
    known: np.ndarray
    prior: np.ndarray
    fps: float

    def rows(self, rows: slice) -> _Held:
        """Some of the frames."""
        return replace(self, given=self.given[rows], free=self.free[rows], known=self.known[rows])

    def spread(self, missed: np.ndarray, frames: np.ndarray, span_s: float) -> np.ndarray:
        """(T, 3) shifts: those of some frames (F, 3), which die away smoothly around them; 0 in keys."""
        wanted, weights = np.zeros((len(self.known), 3)), np.full(len(self.known), LOOSE)
        wanted[frames], weights[frames] = missed, HELD
        times = np.arange(float(len(self.known)))
        return smooth_corrections(wanted, np.zeros_like(wanted), times, self.known, span_s * self.fps, weights)


@dataclass(frozen=True)
class _Target:
    """A pin with the place (F, 3) of each of its frames, and with these places as drawn through the keys."""

    pin: PinnedEnd
    places: np.ndarray
    through_keys: np.ndarray

    @classmethod
    def of(cls, pin: PinnedEnd, pose: SkeletonPose, known: np.ndarray) -> _Target:
        """In a pose of T frames. A pin without a place stays in the middle of where the keys of its range have the
        end; without such keys at the mean of where it is."""
        own, is_key = _point_of(pose, pin.end)[pin.frames], known[pin.frames]
        places = pin.places
        if places is None:
            place = place_of_keys(own[is_key]) if is_key.any() else own.mean(axis=0)
            places = np.tile(place, (len(own), 1))
        if not is_key.any():
            return cls(pin, places, places)
        off, keys = (own - places)[is_key], pin.frames[is_key]
        return cls(pin, places, places + np.stack([np.interp(pin.frames, keys, axis) for axis in off.T], axis=-1))

    def missed(self, pose: SkeletonPose) -> np.ndarray:
        """(F, 3) metres from the end to its place on the way through the keys."""
        return self.through_keys - _point_of(pose, self.pin.end)[self.pin.frames]

    def worst_m(self, pose: SkeletonPose) -> float:
        """The largest of these distances."""
        return float(np.linalg.norm(self.missed(pose), axis=1).max())

    def off_m(self, pose: SkeletonPose) -> np.ndarray:
        """(F,) distance from the end to its place."""
        return np.linalg.norm(self.places - _point_of(pose, self.pin.end)[self.pin.frames], axis=1)


def pin_ends(
    pose: SkeletonPose, fixed: Fixed, known: np.ndarray, fps: float
) -> tuple[SkeletonPose, dict[str, float]]:
    """The pose with pinned ends at their places, and how far each is from its place at most, metres.

    Args:
        pose: T frames, filled, `fps` a second. fixed: of T frames. known: (T,) bool.

    Raises: InputError for an end that stays further from its place than `MOST_M`.
    """
    if not fixed.pins:
        return pose, {}
    keys = np.flatnonzero(known)
    prior = turn_prior(pose.rows(keys).local, OPEN_RAD).double().cpu().numpy()
    held = _Held(fixed.joints | known[:, None], ~known[:, None] & np.isnan(fixed.pelvis), known, prior, fps)
    reach = round(AROUND_S * fps)
    low = max(min(int(pin.frames[0]) for pin in fixed.pins) - reach, 0)
    rows = slice(low, max(int(pin.frames[-1]) for pin in fixed.pins) + reach + 1)
    part, held = pose.rows(rows), held.rows(rows)
    if low > 0:  # the frames at the border stay, so that the clip goes on from them
        held = replace(held, known=held.known | (np.arange(len(part)) == 0))
    if rows.stop < len(pose):
        held = replace(held, known=held.known | (np.arange(len(part)) == len(part) - 1))
    targets = [_Target.of(pin, part, known[rows]) for pin in fixed.rows(rows).pins]
    part = _moved(part, targets, held)
    off: dict[str, float] = {}
    for target in targets:
        distances = target.off_m(part)
        worst = int(distances.argmax())
        name = target.pin.name
        off[name] = max(off.get(name, 0.0), float(distances[worst]))
        if distances[worst] > MOST_M:
            raise InputError(
                f"{name} cannot reach its place in frame {target.pin.frames[worst] + low}: it stays "
                f"{distances[worst] * 1000:.0f} mm away.",
                "Pin it nearer to the body, or for fewer frames, or free more of the body.",
            )
    changed = np.flatnonzero(~held.known)
    return pose.with_rows(changed + low, part.rows(changed)), off


def _moved(pose: SkeletonPose, targets: Sequence[_Target], held: _Held) -> SkeletonPose:
    """The pose with the ends of several pins at their places, as far as the body reaches them."""

    def worst_m(made: SkeletonPose) -> float:
        return max(target.worst_m(made) for target in targets)

    best, since = pose, 0
    for number in range(ROUNDS):
        pose = _with_limbs_turned(pose, targets, held)
        since += 1
        if worst_m(pose) < BETTER * worst_m(best):
            best, since = pose, 0
        if worst_m(best) < (CLOSE_M if number < ROUNDS // 3 else REACHED_M) or since == PATIENCE:
            break
        if worst_m(pose) > DIVERGED * worst_m(best):
            pose = best
        if worst_m(pose) < LEAN_M or number % 2:
            for target in targets:
                if target.worst_m(pose) > REACHED_M:
                    pose = _with_spine_bent(pose, target, held)
            pose = _with_limbs_turned(pose, targets, held)
        far = [target for target in targets if target.worst_m(pose) > REACHED_M]
        if far:
            pose = _with_pelvis_moved(pose, far, held)
    return best


def _with_limbs_turned(pose: SkeletonPose, targets: Sequence[_Target], held: _Held) -> SkeletonPose:
    """The pose with the joints of each pinned end's own limb turned."""
    for target in targets:
        shifts = held.spread(target.missed(pose), target.pin.frames, LIMB_S)
        pose = _turned(pose, list(target.pin.limb), target.pin.end, shifts, held, LIMB_S)
    return pose


def _with_spine_bent(pose: SkeletonPose, target: _Target, held: _Held) -> SkeletonPose:
    """The pose with the spine bent towards a place; the rest of the body keeps its rotations in the parents."""
    skeleton, limb = pose.skeleton, list(target.pin.limb)
    spine = []
    above = int(skeleton.parents[limb[0]])
    while above >= 0 and above != skeleton.root:
        spine.append(above)
        above = int(skeleton.parents[above])
    if not spine:
        return pose
    shifts = held.spread(target.missed(pose), target.pin.frames, BODY_S)
    return _turned(pose, [*spine[::-1], *limb], target.pin.end, shifts, held, BODY_S, stiff=len(spine))


def _with_pelvis_moved(pose: SkeletonPose, targets: Sequence[_Target], held: _Held) -> SkeletonPose:
    """The pose with the pelvis moved towards the places, as far as it is free, and ankles where they were."""
    skeleton, frames = pose.skeleton, len(pose)
    missed, count = np.zeros((frames, 3)), np.zeros((frames, 1))
    for target in targets:
        missed[target.pin.frames] += target.missed(pose)
        count[target.pin.frames] += 1
    asked = np.flatnonzero(count[:, 0])
    shifts = held.spread((missed / np.maximum(count, 1))[asked], asked, BODY_S) * held.free
    moved = pose.corrected(torch.zeros_like(pose.heads), torch.as_tensor(shifts, dtype=torch.float32))
    changed = np.flatnonzero(~held.known)
    moved = pose.with_rows(changed, moved.rows(changed))
    if not has_feet(skeleton):
        return moved
    pinned = {target.pin.end.joint for target in targets}
    for foot in ("left_foot", "right_foot"):
        ankle = end_effector(skeleton, foot, foot)
        leg = ankle.limb(skeleton)
        if leg and ankle.joint not in pinned:
            back = _point_of(pose, ankle) - _point_of(moved, ankle)
            moved = _turned(moved, leg, ankle, back, held, LIMB_S)
    return moved


def _turned(
    pose: SkeletonPose,
    chain: list[int],
    end: EndEffector,
    shifts: np.ndarray,
    held: _Held,
    span_s: float,
    *,
    stiff: int = 0,
) -> SkeletonPose:
    """The pose with a chain of joints turned so that its end is shifted.

    An end that is a joint keeps its direction in the world, and so does what hangs on it, unless some of that is
    given in a frame. What hangs on the chain elsewhere turns with it.

    Args:
        chain: joints from the first on, of which the last moves the end. shifts: (T, 3) metres wanted of the end.
        span_s: seconds over which turns come and go. stiff: joints at the chain's start that shall turn less.
    """
    skeleton = pose.skeleton
    local, rotations, heads = (part.double().cpu().numpy() for part in (pose.local, pose.rotations, pose.heads))
    offsets = pose.offsets.expand(len(pose), -1, 3).double().cpu().numpy()
    last = offsets[:, end.joint] if end.is_head else np.tile(end.tail, (len(pose), 1))
    along = np.concatenate([offsets[:, chain[1:]], last[:, None]], axis=1)
    above = rotations[:, int(skeleton.parents[chain[0]])]
    limb = Limb(local[:, chain], above, heads[:, chain[0]], along)
    prior, stays = held.prior[chain].copy(), held.given[:, chain] | held.known[:, None]
    prior[:stiff] *= SPINE_STIFFER
    turns = None
    for noise_m in NOISES_M:
        turns = solve_limb(
            limb, shifts, prior, stays, noise_m=noise_m, span=span_s * held.fps, start=turns,
            iterations=ITERATIONS, longest_step=LONGEST_STEP,
        )  # fmt: skip
    assert turns is not None
    made = pose.rotations.clone()
    made[:, chain] = torch.as_tensor(limb.turned(turns)[0], dtype=torch.float32)
    hanging = and_below(skeleton.parents, [end.joint]) if end.is_head else []
    # A joint is given in its parent: what hangs on the end turns with it in frames in which any of that is given.
    keeps = torch.as_tensor(~held.given[:, hanging].any(axis=1))[:, None]
    for joint in and_below(skeleton.parents, [chain[0]]):
        if joint not in chain:
            turned = multiply(made[:, int(skeleton.parents[joint])], pose.local[:, joint])
            made[:, joint] = torch.where(keeps, made[:, joint], turned) if joint in hanging else turned
    changed = np.flatnonzero(~held.known)
    return pose.with_rows(changed, replace(pose, held=made, is_global=True).rows(changed))


def _point_of(pose: SkeletonPose, end: EndEffector) -> np.ndarray:
    """(T, 3) metres."""
    tail = torch.as_tensor(end.tail, dtype=torch.float32).expand(len(pose), 3)
    return (pose.heads[:, end.joint] + rotate(pose.rotations[:, end.joint], tail)).double().cpu().numpy()
