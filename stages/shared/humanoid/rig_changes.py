"""Variants of a real rig with known ground truth: more spine joints, twist joints, fingers, other local axes.

Each change returns a new skeleton and the motion on it, in the same conventions as its input.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.shared.kinematics.rotations import continuous_signs

LEAST_SPLIT_M = 0.04  # shorter bones are not split
FINGERS, FINGER_JOINTS, FINGER_M = 4, 2, 0.03


@dataclass(frozen=True)
class Rigged:
    """A motion on its skeleton."""

    skeleton: Skeleton
    motion: Motion


def with_extra_spine(rigged: Rigged, rng: np.random.Generator) -> Rigged:
    """Split every bone of the spine's chain; the new joint takes half the rotation of the joint that follows."""
    return _split_bones(rigged, (BODY_GROUPS.index("spine"),), bend=0.5, suffix="mid")


def with_twist_joints(rigged: Rigged, rng: np.random.Generator) -> Rigged:
    """Split every long bone of arms and legs; the new joint is in the chain and its local rotation is zero."""
    return _split_bones(rigged, tuple(range(1, len(BODY_GROUPS))), bend=0.0, suffix="twist")


def with_fingers(rigged: Rigged, rng: np.random.Generator) -> Rigged:
    """Add four fingers of two joints to each hand, without points on them; they curl in a slow wave."""
    skeleton = rigged.skeleton
    for group in (1, 2):
        hands = np.flatnonzero((skeleton.groups == group) & skeleton.sampled)
        for finger in range(FINGERS):
            joint = int(hands[-1])
            for part in range(FINGER_JOINTS):
                tail = rigged.skeleton.tails[joint]
                side = np.cross(tail, [0.3, 0.2, 0.9])
                side *= (finger - 1.5) * 0.02 / max(float(np.linalg.norm(side)), 1e-9)
                along = tail if part else tail + side
                reach = FINGER_M * tail / max(float(np.linalg.norm(tail)), 1e-9)
                wave = 0.4 + 0.4 * np.sin(np.arange(rigged.motion.frames) / rigged.motion.fps + rng.uniform(0, 6))
                curl = Rotation.from_rotvec(wave[:, None] * _across(tail))
                parent = Rotation.from_quat(rigged.motion.rotations[:, joint])
                new = _Joint(f"finger{finger}{part}", joint, along, reach, group, False)
                rigged = _appended(rigged, new, (parent * curl).as_quat())
                joint = rigged.skeleton.joints - 1
    return rigged


def with_other_axes(rigged: Rigged, rng: np.random.Generator) -> Rigged:
    """The same bones in the same places, with every joint's own axes turned by a random constant rotation."""
    skeleton, motion = rigged.skeleton, rigged.motion
    turns = Rotation.from_quat(rng.standard_normal((skeleton.joints, 4)))
    above = [turns[int(parent)] if parent >= 0 else Rotation.identity() for parent in skeleton.parents]
    offsets = np.stack([a.inv().apply(o) for a, o in zip(above, skeleton.offsets, strict=True)])
    tails = np.stack([t.inv().apply(o) for t, o in zip(turns, skeleton.tails, strict=True)])
    rotations = np.stack(
        [(Rotation.from_quat(motion.rotations[:, j]) * turns[j]).as_quat() for j in range(skeleton.joints)], axis=1
    )
    tracks = np.array(motion.tracks)
    for column, joint in enumerate(motion.track_joints):
        tracks[:, column] = above[int(joint)].inv().apply(motion.tracks[:, column])
    turned = replace(
        motion, rotations=continuous_signs(rotations).astype(np.float32), tracks=tracks.astype(np.float32)
    )
    return Rigged(replace(skeleton, offsets=offsets, tails=tails, header=""), turned)


def with_other_proportions(rigged: Rigged, rng: np.random.Generator) -> Rigged:
    """The same rotations on a body with each body group 15% longer or shorter."""
    skeleton, motion = rigged.skeleton, rigged.motion
    factors = np.ones(len(BODY_GROUPS) + 1)
    factors[:-1] = np.exp(rng.choice([-1, 1], len(BODY_GROUPS)) * np.log(1.15))
    factors[[2, 4]] = factors[[1, 3]]  # left and right alike
    own = factors[skeleton.groups][:, None]
    root_height = motion.root_positions * factors[3]
    tracks = np.array(motion.tracks) * factors[3] if skeleton.root in motion.track_joints else motion.tracks
    changed = replace(motion, root_positions=root_height.astype(np.float32), tracks=tracks.astype(np.float32))
    return Rigged(replace(skeleton, offsets=skeleton.offsets * own, tails=skeleton.tails * own, header=""), changed)


def with_stiff_spine(rigged: Rigged) -> Rigged:
    """A rig of fewer joints: the spine's joints above the pelvis, up to those that the arms hang on, turn as one.

    They take their mean rotation in every frame. All other joints keep their global rotations and move with them.
    """
    skeleton, motion = rigged.skeleton, rigged.motion
    spine = BODY_GROUPS.index("spine")
    below_arms = np.zeros(skeleton.joints, bool)
    for joint in np.flatnonzero(np.isin(skeleton.groups, (1, 2))):
        while joint >= 0:
            below_arms[joint] = True
            joint = int(skeleton.parents[joint])
    stiff = np.flatnonzero(below_arms & (skeleton.groups == spine) & (np.arange(skeleton.joints) != skeleton.root))
    if len(stiff) < 2:
        return rigged
    rotations = np.array(motion.rotations)
    for frame in range(motion.frames):
        rotations[frame, stiff] = Rotation.from_quat(motion.rotations[frame, stiff]).mean().as_quat()
    return Rigged(skeleton, replace(motion, rotations=continuous_signs(rotations).astype(np.float32)))


RIGS: dict[str, Callable[[Rigged, np.random.Generator], Rigged]] = {
    "extra-spine": with_extra_spine,
    "twist-joints": with_twist_joints,
    "fingers": with_fingers,
    "other-axes": with_other_axes,
    "all-of-these": lambda rigged, rng: with_other_axes(
        with_fingers(with_twist_joints(with_extra_spine(rigged, rng), rng), rng), rng
    ),
}


@dataclass(frozen=True)
class _Joint:
    name: str
    parent: int
    offset: np.ndarray
    tail: np.ndarray
    group: int
    sampled: bool


def _split_bones(rigged: Rigged, groups: tuple[int, ...], bend: float, suffix: str) -> Rigged:
    """Add a joint in the middle of each sampled bone of some groups that is followed by another sampled bone."""
    done: set[str] = set()
    while True:
        skeleton = rigged.skeleton
        pair = _next_pair(skeleton, groups, done)
        if pair is None:
            return rigged
        joint, child = pair
        done.add(skeleton.names[joint])
        half = skeleton.offsets[child] / 2
        start, end = (Rotation.from_quat(rigged.motion.rotations[:, j]) for j in (joint, child))
        turned = (start * Rotation.from_rotvec(bend * (start.inv() * end).as_rotvec())).as_quat()
        name = f"{skeleton.names[joint]}_{suffix}"
        done.add(name)
        new = _Joint(name, joint, half, half, int(skeleton.groups[joint]), True)
        rigged = _inserted(rigged, child, new, turned)


def _next_pair(skeleton: Skeleton, groups: tuple[int, ...], done: set[str]) -> tuple[int, int] | None:
    for joint in np.flatnonzero(skeleton.sampled & np.isin(skeleton.groups, groups)):
        if skeleton.names[joint] in done:
            continue
        for child in np.flatnonzero(skeleton.parents == joint):
            alike = np.allclose(skeleton.offsets[child], skeleton.tails[joint], atol=1e-6)
            if alike and skeleton.sampled[child] and np.linalg.norm(skeleton.offsets[child]) >= LEAST_SPLIT_M:
                return int(joint), int(child)
    return None


def _inserted(rigged: Rigged, child: int, new: _Joint, rotations: np.ndarray) -> Rigged:
    """Insert the new joint between `child` and its parent, right before `child` in the order."""
    skeleton, motion = rigged.skeleton, rigged.motion
    moved = np.where(skeleton.parents >= child, skeleton.parents + 1, skeleton.parents)
    parents = np.insert(moved, child, new.parent).astype(np.int32)
    parents[child + 1] = child
    offsets = np.insert(skeleton.offsets, child, new.offset, axis=0)
    offsets[child + 1] = skeleton.offsets[child] - new.offset
    tails = np.insert(skeleton.tails, child, new.tail, axis=0)
    tails[new.parent] = new.offset
    tracks = np.where(motion.track_joints >= child, motion.track_joints + 1, motion.track_joints).astype(np.int32)
    return Rigged(
        replace(
            skeleton,
            names=(*skeleton.names[:child], new.name, *skeleton.names[child:]),
            parents=parents,
            offsets=offsets,
            tails=tails,
            groups=np.insert(skeleton.groups, child, new.group).astype(np.int8),
            sampled=np.insert(skeleton.sampled, child, new.sampled),
            root=skeleton.root + int(skeleton.root >= child),
            header="",
        ),
        replace(
            motion,
            rotations=continuous_signs(np.insert(motion.rotations, child, rotations, axis=1)).astype(np.float32),
            track_joints=tracks,
        ),
    )


def _appended(rigged: Rigged, new: _Joint, rotations: np.ndarray) -> Rigged:
    """Append the new joint after all others."""
    skeleton, motion = rigged.skeleton, rigged.motion
    every = np.concatenate([motion.rotations, rotations[:, None]], axis=1)
    return Rigged(
        replace(
            skeleton,
            names=(*skeleton.names, f"{skeleton.names[new.parent]}_{new.name}"),
            parents=np.append(skeleton.parents, new.parent).astype(np.int32),
            offsets=np.vstack([skeleton.offsets, new.offset]),
            tails=np.vstack([skeleton.tails, new.tail]),
            groups=np.append(skeleton.groups, new.group).astype(np.int8),
            sampled=np.append(skeleton.sampled, new.sampled),
            header="",
        ),
        replace(motion, rotations=continuous_signs(every).astype(np.float32)),
    )


def _across(vector: np.ndarray) -> np.ndarray:
    """A unit vector perpendicular to another."""
    axis = np.cross(vector, [0.0, 0.0, 1.0] if abs(vector[2]) < 0.9 * np.linalg.norm(vector) else [1.0, 0.0, 0.0])
    return axis / max(float(np.linalg.norm(axis)), 1e-9)
