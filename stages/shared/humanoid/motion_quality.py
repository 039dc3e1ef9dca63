"""Measures of what may be wrong with a recording, from the recording alone; fast enough for every ingest.

They become columns of the clip index, by which clips can be filtered. `data_schemas.quality` defines each of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from data_schemas.errors import InputError
from data_schemas.quality import MotionQuality
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.bone_matching import ARMS, LEGS, SPINE, bones_of
from stages.shared.humanoid.facing import off_line
from stages.shared.kinematics.foot_contacts import (
    Feet,
    detect_contacts,
    find_feet,
    floor_levels,
    foot_skate_mps,
    has_feet,
    limb_joints,
)
from stages.shared.kinematics.forward_numpy import BLOCK_FRAMES
from stages.shared.kinematics.playback_speed import rate_is_suspect, speed_features, speed_of
from stages.shared.kinematics.quantiles import median, percentile
from stages.shared.kinematics.rotations import rotate

STILL_MPS = 0.01  # a body is still if no joint moves faster
HUMAN_RAD_PER_S = 45.0  # faster than a pitcher's forearm, without the turn of the body
FLIP_RAD = 2.0  # between two frames: an axis that flipped
T_POSE_RAD = 0.35  # largest angle between the arms and straight out sideways, while the body is still
FACING_FRAMES = 32
LEAST_S = 0.5  # shortest T-pose or stillness that is counted


@dataclass(frozen=True)
class _Joints:
    """The joints of a rig that are looked at. legs, arms: the bones of each limb; None where a limb has none.

    body: (K,) all that count. limbs: (2, 3) hip, knee and ankle of each leg. chest: the last bone of the spine.
    """

    body: np.ndarray
    feet: Feet | None
    limbs: np.ndarray | None
    legs: tuple[tuple[int, ...], ...] | None
    arms: tuple[tuple[int, ...], ...] | None
    chest: int | None


def measure_quality(
    skeleton: Skeleton, motion: Motion, positions: np.ndarray, repaired_frames: int = 0
) -> MotionQuality:
    """All measures of one clip.

    Args:
        positions: (T, J, 3) its joints in the world, metres; passed in, since readers compute them without torch.
        repaired_frames: number of frames that its reader repaired.
    """
    joints = _joints_of(skeleton)
    feet = joints.feet
    spikes, flips = _fast_turns(motion.rotations, joints.body, motion.fps)
    features = None if feet is None else speed_features(skeleton, positions, motion.fps, feet)
    still = _still(positions, joints.body, motion.fps)
    skate, penetration = _feet(feet, positions, motion.fps)
    return MotionQuality(
        still_share=float(still.mean()),
        t_pose=_t_pose(joints, positions, still),
        repeated_share=_repeated(motion),
        spikes=spikes,
        flips=flips,
        foot_skate=skate,
        floor_penetration=penetration,
        speed_log2=None if features is None else speed_of(features),
        wrong_rate=features is not None and rate_is_suspect(features),
        swapped=_swapped(skeleton, joints, positions, motion.rotations),
        repaired_frames=repaired_frames,
    )


def _joints_of(skeleton: Skeleton) -> _Joints:
    arrays = (skeleton.parents, skeleton.groups, skeleton.sampled, skeleton.offsets)
    kinds = (np.int32, np.int8, np.bool_, np.float64)
    return _found_joints(*(np.asarray(each, kind).tobytes() for each, kind in zip(arrays, kinds, strict=True)))


@lru_cache(maxsize=64)
def _found_joints(parents: bytes, groups: bytes, sampled: bytes, offsets: bytes) -> _Joints:
    """Once a rig: finding them takes a tenth of the time of measuring a short clip."""
    places = np.frombuffer(offsets).reshape(-1, 3)
    skeleton = Skeleton(
        ("",) * len(places), np.frombuffer(parents, np.int32), places, np.zeros_like(places),
        np.frombuffer(groups, np.int8), np.frombuffer(sampled, bool), root=0,
    )  # fmt: skip
    feet = find_feet(skeleton) if has_feet(skeleton) else None
    spine = _bones(skeleton, (SPINE,))
    return _Joints(
        body=np.flatnonzero((skeleton.groups >= 0) & skeleton.sampled),
        feet=feet,
        limbs=None if feet is None else limb_joints(skeleton, feet),
        legs=_bones(skeleton, LEGS),
        arms=_bones(skeleton, ARMS),
        chest=None if spine is None else spine[0][-1],
    )


def _bones(skeleton: Skeleton, groups: tuple[int, ...]) -> tuple[tuple[int, ...], ...] | None:
    try:
        return tuple(bones_of(skeleton, group) for group in groups)
    except InputError:
        return None


def _fast_turns(rotations: np.ndarray, body: np.ndarray, fps: float) -> tuple[int, int]:
    """Number of frames after which a joint turns faster than a human does, and of those after which it flips.

    Args:
        rotations: (T, J, 4) global. body: (K,) the joints that count.
    """
    least = min(FLIP_RAD, HUMAN_RAD_PER_S / fps)
    nearly = np.cos(least / 2) + 1e-9 if least < np.pi else 0.0  # only angles of cosines below it can be too large
    spikes = flips = 0
    for turns in _blocks(rotations, body):
        x, y, z, w = turns[..., 1:] * turns[..., :-1]
        cosine = np.abs(x + y + z + w).min(axis=0)  # of the joint that turns most
        turned = 2 * np.arccos(np.clip(cosine[cosine <= nearly], 0, 1))
        spikes += int((turned * fps > HUMAN_RAD_PER_S).sum())
        flips += int((turned > FLIP_RAD).sum())
    return spikes, flips


def _blocks(values: np.ndarray, body: np.ndarray) -> Iterator[np.ndarray]:
    """Values (T, J, C) of some joints (K,) as float64 (C, K, N), time last.

    Each block also holds the first frame of the next one.
    """
    for start in range(0, max(len(values) - 1, 1), BLOCK_FRAMES):
        block = values[start : start + BLOCK_FRAMES + 1].transpose(2, 1, 0)
        yield np.array(block, np.float64, order="C")[:, body]  # choosing joints first would take three times as long


def _still(positions: np.ndarray, body: np.ndarray, fps: float) -> np.ndarray:
    """(T,) bool: frames in stretches of `LEAST_S` or longer in which no joint of the body (K,) moves."""
    furthest = [np.zeros(0)]
    for places in _blocks(positions, body):
        x, y, z = np.square(np.diff(places, axis=-1))
        furthest.append((x + y + z).max(axis=0))
    speeds = np.sqrt(np.concatenate(furthest)) * fps
    quiet = np.concatenate([speeds < STILL_MPS, [False]]) if len(speeds) else np.zeros(len(positions), bool)
    out = np.zeros(len(positions), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]])))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - start >= LEAST_S * fps:
            out[start : stop + 1] = True
    return out


def _repeated(motion: Motion) -> float:
    if motion.frames < 2:
        return 0.0
    same = (motion.rotations[1:] == motion.rotations[:-1]).all(axis=(1, 2))
    same &= (motion.root_positions[1:] == motion.root_positions[:-1]).all(axis=1)
    if len(motion.track_joints):
        same &= (motion.tracks[1:] == motion.tracks[:-1]).all(axis=(1, 2))
    return float(same.mean())


def _t_pose(joints: _Joints, positions: np.ndarray, still: np.ndarray) -> bool:
    """Whether, in some still stretch, both arms are straight and point away from each other along the hips' line."""
    if joints.legs is None or joints.arms is None or not still.any():
        return False
    hips = [positions[still, leg[0]] for leg in joints.legs]
    hands = [positions[still, arm[-1]] for arm in joints.arms]
    shoulders = [positions[still, arm[0]] for arm in joints.arms]
    across = _unit(hips[0] - hips[1])
    left, right = (_unit(hand - shoulder) for hand, shoulder in zip(hands, shoulders, strict=True))
    outward = np.minimum((left * across).sum(-1), -(right * across).sum(-1))
    return bool((outward > np.cos(T_POSE_RAD)).any())


def _feet(feet: Feet | None, positions: np.ndarray, fps: float) -> tuple[float | None, float | None]:
    """Foot skate, and how far the feet's lowest percentile is below the level on which they mostly stand."""
    if feet is None:
        return None, None
    levels = floor_levels(positions, feet)
    contacts = detect_contacts(positions, feet, fps, levels=levels)
    if not contacts.any():
        return None, None
    heights = positions[:, feet.joints, 1]
    for i, on in enumerate(contacts.T):
        levels[i] = median(heights[on, i]) if on.any() else levels[i]
    sunk = np.maximum(levels - percentile(heights, 1), 0.0)
    skate = foot_skate_mps(positions, contacts, feet, fps)
    return (skate if np.isfinite(skate) else None), float(sunk.max())


def _swapped(skeleton: Skeleton, joints: _Joints, positions: np.ndarray, rotations: np.ndarray) -> bool:
    """Whether toes and knees point backwards, by the hips, the chest and the named sides.

    Faster than `stages.shared.humanoid.facing`, which finds the sides of joints without names.
    """
    legs, limbs, chest = joints.legs, joints.limbs, joints.chest
    if legs is None or limbs is None or chest is None:
        return False
    some = np.unique(np.linspace(0, len(positions) - 1, FACING_FRAMES).astype(int))
    places = positions[some].astype(np.float64)
    hips = [places[:, hip] for hip, _, _ in limbs]
    forward = _unit(np.cross(hips[0] - hips[1], places[:, chest] - (hips[0] + hips[1]) / 2))  # left x up
    votes = 0.0
    for leg, (hip, knee, ankle) in zip(legs, limbs, strict=True):
        last = leg[-1]
        turned_tails = rotate(rotations[some, last].astype(np.float64), skeleton.tails[last])
        toes = places[:, last] - places[:, ankle] + turned_tails
        bend = off_line(places[:, [knee]], places[:, hip], places[:, ankle])[:, 0]
        votes += float(((toes + bend) * forward).sum(-1).mean())
    return votes < 0


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
