"""The forward direction of a body, found from its poses alone: toes, knees, elbows, hands, and the way it walks.

It determines left and right if names do not state them, since left is up x forward. Everything is measured in the
body's own frame, so that a turned world or arbitrary local axes do not change the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.shared.humanoid.body_groups import LEFT_ARM, LEFT_LEG, RIGHT_ARM, RIGHT_LEG, SPINE, BodyParts

# Weight of each sign; docs/formats.md states how often each is right on real clips.
_WEIGHTS = {"toes": 6.0, "knees": 4.0, "elbows": 1.0, "hands": 0.7, "walking": 1.0}
SIGNS = tuple(_WEIGHTS)
_LEAST_SPEED = 0.35  # leg lengths per second; a slower body is not walking


@dataclass(frozen=True)
class BodyPoses:
    """A body in F poses, any unit, any axes.

    heads: (F, J, 3) joints. tips: (F, J, 3) ends of bones; NaN where unknown (a leaf without End Site).
    spacing_s: seconds from one pose to the next; 0 if they are not consecutive.
    """

    heads: np.ndarray
    tips: np.ndarray
    spacing_s: float = 0.0


@dataclass(frozen=True)
class Facing:
    """The directions of a body, and the signs that support them.

    forward, left, up: (F, 3) unit vectors of the body in each pose.
    signs:   by sign ("toes", "knees", ...), -1 to 1: positive if it indicates that left and right are as labelled,
             negative if it indicates that they are swapped.
    balance: weighted mean of the signs, -1 to 1; 0 if there are none.
    """

    forward: np.ndarray
    left: np.ndarray
    up: np.ndarray
    signs: dict[str, float]
    balance: float


def bone_tips(heads: np.ndarray, rotations: np.ndarray, tails: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(F, J, 3) ends of bones, from heads (F, J, 3), global rotations (F, J, 4) xyzw and tails (J, 3).

    NaN where `known` (J,) is False, since the tail is a guess there.
    """
    vector, scalar = rotations[..., :3], rotations[..., 3:]
    twice = 2.0 * np.cross(vector, tails)
    tips = heads + tails + scalar * twice + np.cross(vector, twice)
    return np.where(known[:, None], tips, np.nan)


def find_facing(poses: BodyPoses, parts: BodyParts) -> Facing:
    """Forward, left and up of a body whose groups are known, and the signs for which side is left."""
    up, left = _trunk_axes(poses.heads, parts)
    forward = _unit(np.cross(left, up))
    signs: dict[str, float] = {}
    legs = [_limb(poses, parts, group) for group in (LEFT_LEG, RIGHT_LEG)]
    arms = [_limb(poses, parts, group) for group in (LEFT_ARM, RIGHT_ARM)]
    _add(signs, "toes", [_toes(leg, left) for leg in legs], scale=0.5)
    _add(signs, "knees", [_bend(leg, left) for leg in legs], scale=0.05)
    _add(signs, "elbows", [-_bend(arm, left) for arm in arms], scale=0.1)
    size = float(np.median([_arc(leg).max() for leg in legs]))
    chest = np.mean([arm[:, 0] for arm in arms], axis=0)
    reach = np.mean([arm[:, -1] for arm in arms], axis=0) - chest
    _add(signs, "hands", [(reach * forward).sum(-1) / max(size, 1e-9)], scale=0.15)
    _add(signs, "walking", [_walk(poses, parts, forward, size)], scale=0.5)
    weights = sum(_WEIGHTS.values())
    balance = sum(_WEIGHTS[name] * value for name, value in signs.items()) / weights
    return Facing(forward, left, up, signs, float(balance))


def find_sides(poses: BodyPoses, parts: BodyParts) -> tuple[BodyParts, Facing]:
    """The parts with left and right found from the poses, for parts whose sides are a guess.

    First the arms are put on the same side as the legs, then both sides are chosen by the forward direction. Without
    any sign the guess is kept.
    """
    firsts, seconds = _beginnings(poses.heads, parts)
    up = _unit((firsts[LEFT_ARM] + firsts[RIGHT_ARM] - firsts[LEFT_LEG] - firsts[RIGHT_LEG]) / 2)
    across = [_across(firsts, seconds, *pair) for pair in ((LEFT_LEG, RIGHT_LEG), (LEFT_ARM, RIGHT_ARM))]
    legs, arms = (side - (side * up).sum(-1, keepdims=True) * up for side in across)
    if float((legs * arms).sum()) < 0:
        parts = parts.with_arms_exchanged()
    facing = find_facing(poses, parts)
    if facing.balance >= 0:
        return parts, facing
    parts = parts.mirrored()
    return parts, find_facing(poses, parts)


def stands_on_four_feet(heads: np.ndarray, rest: np.ndarray, parts: BodyParts) -> bool:
    """Whether a body stands on four feet, as an animal does.

    In more than nine poses of ten its legs do not continue the line of the trunk, and its arms are parallel to the
    legs and nearly as long.

    Args:
        heads: (F, J, 3) joints in some poses.
        rest: (J, 3) joints at zero rotations; if they form an upright standing pose, the result is False.
    """
    upright, _, _ = _posture(rest[None], parts)
    if upright[0] > 0.8 and all(_straightness(rest, parts.chains[g]) > 0.8 for g in (SPINE, LEFT_LEG, RIGHT_LEG)):
        return False
    upright, hanging, ratio = _posture(heads, parts)
    return bool(ratio > 0.65 and ((upright < 0.65) & (hanging > 0.75)).mean() > 0.9)


def _straightness(rest: np.ndarray, chain: tuple[int, ...]) -> float:
    """Distance from the first joint to the last, over the length along the chain; low for a meaningless pose."""
    along = np.linalg.norm(np.diff(rest[list(chain)], axis=0), axis=-1).sum()
    return float(np.linalg.norm(rest[chain[-1]] - rest[chain[0]]) / along) if along > 0 else 1.0


def _posture(heads: np.ndarray, parts: BodyParts) -> tuple[np.ndarray, np.ndarray, float]:
    """(F,) cosine between trunk and legs (both upwards), (F,) cosine between arms and legs, ratio of their lengths.

    The ratio is the arms' length from shoulder to hand over the legs' from hip to foot.
    """
    ends = {group: heads[:, parts.chains[group][-1]] - heads[:, parts.chains[group][0]] for group in range(1, 5)}
    legs, arms = ends[LEFT_LEG] + ends[RIGHT_LEG], ends[LEFT_ARM] + ends[RIGHT_ARM]
    firsts, _ = _beginnings(heads, parts)
    trunk = firsts[LEFT_ARM] + firsts[RIGHT_ARM] - firsts[LEFT_LEG] - firsts[RIGHT_LEG]
    down = _unit(legs)
    lengths = [np.mean([np.linalg.norm(ends[g], axis=-1).max() for g in pair]) for pair in ((1, 2), (3, 4))]
    return -(_unit(trunk) * down).sum(-1), (_unit(arms) * down).sum(-1), float(lengths[0] / max(lengths[1], 1e-9))


def knee_of(limb: np.ndarray) -> int:
    """Index of the knee or elbow in a limb's points (F, K, 3), first joint to tip: the one nearest the middle."""
    along = _arc(limb)
    return 1 + int(np.abs(along[1:-1] - along[-1] / 2).argmin()) if limb.shape[1] > 2 else 0


def ankle_of(limb: np.ndarray) -> int:
    """Index of the ankle or wrist: the joint below the knee that is farthest off the line from knee to tip."""
    knee = knee_of(limb)
    if limb.shape[1] - knee < 3:
        return limb.shape[1] - 1
    off = off_line(limb[:, knee + 1 : -1], limb[:, knee], limb[:, -1])
    return knee + 1 + int(np.linalg.norm(off, axis=-1).mean(axis=0).argmax())


def _trunk_axes(heads: np.ndarray, parts: BodyParts) -> tuple[np.ndarray, np.ndarray]:
    """(F, 3) up along the trunk and left across it, at right angles."""
    firsts, seconds = _beginnings(heads, parts)
    hips = (firsts[LEFT_LEG] + firsts[RIGHT_LEG]) / 2
    shoulders = (firsts[LEFT_ARM] + firsts[RIGHT_ARM]) / 2
    up = shoulders - hips
    flat = np.linalg.norm(up, axis=-1) < 1e-6 * max(float(np.abs(heads).max()), 1e-9)
    up[flat] = (heads[:, parts.chains[SPINE][-1]] - hips)[flat]
    up = _unit(up)
    # Hips and shoulders twist against each other; their sum gives the trunk's direction even if one has no width.
    across = _across(firsts, seconds, LEFT_LEG, RIGHT_LEG)
    across = across + _across(firsts, seconds, LEFT_ARM, RIGHT_ARM)
    left = _unit(across - (across * up).sum(-1, keepdims=True) * up)
    return up, left


def _beginnings(heads: np.ndarray, parts: BodyParts) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
    """(F, 3) first joint, and (F, 3) second joint, of every limb, by group."""
    chains = {group: parts.chains[group] for group in range(LEFT_ARM, RIGHT_LEG + 1)}
    return {g: heads[:, c[0]] for g, c in chains.items()}, {g: heads[:, c[:2][-1]] for g, c in chains.items()}


def _across(firsts: dict[int, np.ndarray], seconds: dict[int, np.ndarray], left: int, right: int) -> np.ndarray:
    """Vector from the right limb's beginning to the left one's.

    Of each limb the first two joints are used, since the first may lie on the midline (collars that begin at the
    breastbone).
    """
    return _unit(firsts[left] - firsts[right] + seconds[left] - seconds[right])


def _limb(poses: BodyPoses, parts: BodyParts, group: int) -> np.ndarray:
    """(F, K, 3) a limb's joints and, if it is known, its tip."""
    chain = list(parts.chains[group])
    tip = poses.tips[:, chain[-1:]]
    points = poses.heads[:, chain]
    return np.concatenate([points, tip], axis=1) if np.isfinite(tip).all() else points


def _arc(limb: np.ndarray) -> np.ndarray:
    """(K,) length along a limb from its first joint to each of its points."""
    steps = np.linalg.norm(np.diff(limb, axis=1), axis=-1).mean(axis=0)
    return np.concatenate([[0.0], np.cumsum(steps)])


def off_line(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(F, K, 3) perpendicular offsets of points (F, K, 3) from the lines from start to end (F, 3)."""
    along = _unit(end - start)[:, None]
    away = points - start[:, None]
    return away - (away * along).sum(-1, keepdims=True) * along


def _bend(limb: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(F,) how far the knee is in front of the line from hip to ankle, in limb lengths (negative: behind)."""
    if limb.shape[1] < 3:
        return np.zeros(len(limb))
    knee, ankle = knee_of(limb), ankle_of(limb)
    if ankle <= knee:
        return np.zeros(len(limb))
    off = off_line(limb[:, knee : knee + 1], limb[:, 0], limb[:, ankle])[:, 0]
    forward = np.cross(left, _unit(limb[:, 0] - limb[:, ankle]))
    return (off * forward).sum(-1) / max(_arc(limb)[ankle], 1e-9)


def _toes(leg: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(F,) -1 to 1: how far the foot points forward of the shin."""
    knee, ankle = knee_of(leg), ankle_of(leg)
    if ankle >= leg.shape[1] - 1 or ankle <= knee:
        return np.zeros(len(leg))
    shin = _unit(leg[:, knee] - leg[:, ankle])
    forward = _unit(np.cross(left, shin))
    return (_unit(leg[:, -1] - leg[:, ankle]) * forward).sum(-1)


def _walk(poses: BodyPoses, parts: BodyParts, forward: np.ndarray, size: float) -> np.ndarray:
    """(F,) cosine between the pelvis' velocity and forward, times the certainty that the body is walking."""
    frames = len(poses.heads)
    if frames < 2 or poses.spacing_s <= 0 or size <= 0:
        return np.zeros(frames)
    velocity = np.gradient(poses.heads[:, parts.pelvis], poses.spacing_s, axis=0) / size
    speed = np.linalg.norm(velocity, axis=-1)
    cosine = (velocity * forward).sum(-1) / np.maximum(speed, 1e-9)
    return np.where(speed > _LEAST_SPEED, cosine, 0.0)


def _add(signs: dict[str, float], name: str, votes: list[np.ndarray], scale: float) -> None:
    """Store the mean of a sign's values, compressed to -1 to 1."""
    signs[name] = float(np.tanh(np.mean([vote.mean() for vote in votes]) / scale))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
