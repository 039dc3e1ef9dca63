"""Changes that leave a body what it is: other names, other bone lengths, another order, another world, other axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from stages.shared.formats.source_body import SourcePoses, SourceRig

Body = tuple[SourceRig, SourcePoses]


def changed(
    rig: SourceRig, poses: SourcePoses, change: str, rng: np.random.Generator
) -> tuple[SourceRig, SourcePoses, np.ndarray]:
    """The rig without names and changed in its "lengths", "order", "world", "axes", or in "all" of these; and which
    old joint each new one is."""
    rig, poses = renamed(rig, poses)
    if change in ("lengths", "all"):
        rig, poses = resized(rig, poses, rng)
    if change in ("world", "all"):
        rig, poses = turned(rig, poses, rng)
    if change in ("axes", "all"):
        rig, poses = with_other_axes(rig, poses, rng)
    if change in ("order", "all"):
        return shuffled(rig, poses, rng)
    return rig, poses, np.arange(len(rig.names))


def renamed(rig: SourceRig, poses: SourcePoses) -> Body:
    """j0, j1, ..."""
    return replace(rig, names=tuple(f"j{joint}" for joint in range(len(rig.names)))), poses


def resized(rig: SourceRig, poses: SourcePoses, rng: np.random.Generator, share: float = 0.15) -> Body:
    """Every bone longer or shorter by up to `share`, each by itself, so that left and right differ too."""
    factors = rng.uniform(1 - share, 1 + share, len(rig.names))
    offsets = np.array(rig.offsets) * factors[:, None]
    ends = np.array(rig.end_sites) * factors[:, None]
    return replace(rig, offsets=_tuples(offsets), end_sites=_tuples(ends)), poses


def shuffled(
    rig: SourceRig, poses: SourcePoses, rng: np.random.Generator
) -> tuple[SourceRig, SourcePoses, np.ndarray]:
    """Joints in another order, parents before children; and which old joint each new one is."""
    children: list[list[int]] = [[] for _ in rig.names]
    for joint, parent in enumerate(rig.parents):
        if parent >= 0:
            children[parent].append(joint)
    order, waiting = [], [0]
    while waiting:
        order.append(waiting.pop(int(rng.integers(len(waiting)))))
        waiting += children[order[-1]]
    place = {old: new for new, old in enumerate(order)}
    moving = sorted(poses.moving, key=lambda joint: place[joint])
    at = [list(poses.moving).index(joint) for joint in moving]
    new = replace(
        rig,
        names=tuple(rig.names[j] for j in order),
        parents=tuple(place[rig.parents[j]] if rig.parents[j] >= 0 else -1 for j in order),
        offsets=tuple(rig.offsets[j] for j in order),
        end_sites=tuple(rig.end_sites[j] for j in order),
        placed=tuple(rig.placed[j] for j in order),
    )
    tracks = poses.tracks[:, at] if len(moving) else poses.tracks
    posed = replace(poses, local=poses.local[:, order], moving=[place[j] for j in moving], tracks=tracks)
    return new, posed, np.array(order)


def turned(rig: SourceRig, poses: SourcePoses, rng: np.random.Generator) -> Body:
    """The whole world turned any way."""
    turn = Rotation.random(random_state=rng)  # pyright: ignore[reportCallIssue]
    local = poses.local.copy()
    local[:, 0] = (turn * Rotation.from_quat(local[:, 0])).as_quat()
    return rig, replace(poses, local=local, root=turn.apply(poses.root))


def with_other_axes(rig: SourceRig, poses: SourcePoses, rng: np.random.Generator) -> Body:
    """Every joint's own axes turned any way: the zero pose means nothing any more, the motion is the same."""
    axes = Rotation.random(len(rig.names), random_state=rng)  # pyright: ignore[reportCallIssue]
    local, offsets, ends = poses.local.copy(), np.array(rig.offsets), np.array(rig.end_sites)
    tracks = poses.tracks.copy()
    for joint, parent in enumerate(rig.parents):
        own = Rotation.from_quat(poses.local[:, joint]) * axes[joint]
        above = axes[parent].inv() if parent >= 0 else Rotation.identity()
        local[:, joint] = (above * own).as_quat()
        offsets[joint] = above.apply(offsets[joint])
        ends[joint] = axes[joint].inv().apply(ends[joint])
        if joint in poses.moving:
            at = list(poses.moving).index(joint)
            tracks[:, at] = above.apply(tracks[:, at])
    return replace(rig, offsets=_tuples(offsets), end_sites=_tuples(ends)), replace(poses, local=local, tracks=tracks)


def _tuples(rows: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple(map(tuple, rows.tolist()))
