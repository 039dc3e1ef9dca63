"""A motion as a stick figure that pages draw: the body's joints, the tips of its last bones, and its bones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import NO_GROUP, Skeleton

LARGEST_STEP = 32767  # positions are sent as 16-bit numbers, a fraction of a millimetre apart
LEAST_BONE_M = 1e-4


@dataclass(frozen=True)
class StickFigure:
    """What is drawn of T frames.

    points: (T, N, 3) float64 metres in the world.
    edges:  bones: [from, to, body group, 1 for a thin bone, 1 for the bone that carries the head's ball].
    root:   the pelvis' point. joints: (N,) int64, the joint of each point; of a tip, the joint that it ends.
    """

    points: np.ndarray
    edges: list[list[int]]
    root: int
    joints: np.ndarray

    @property
    def floor_m(self) -> float:
        """Height of the ground: where the lowest points are, apart from a few frames."""
        return float(np.percentile(self.points[..., 1].min(axis=1), 2))

    @property
    def height_m(self) -> float:
        """How tall the figure stands."""
        return float(np.percentile(np.ptp(self.points[..., 1], axis=1), 90))

    @property
    def size_m(self) -> float:
        """How far it reaches along its longest axis."""
        return float(np.percentile(np.ptp(self.points, axis=1).max(axis=1), 90))

    def ground_centre(self) -> np.ndarray:
        """(3,) the pelvis' mean place, at height 0."""
        return self.points[:, self.root].mean(axis=0) * [1, 0, 1]

    def quantised(self, origin: np.ndarray) -> tuple[np.ndarray, float]:
        """Points around `origin` (3,) as (T, N, 3) int16, little-endian, and the metres of one step."""
        around = self.points - origin
        scale = max(float(np.abs(around).max()), 1e-6) / LARGEST_STEP
        return np.round(around / scale).astype("<i2"), scale


def stick_figure(skeleton: Skeleton, heads: np.ndarray, rotations: np.ndarray) -> StickFigure:
    """The body's joints, and the tips of its last bones.

    Args:
        heads: (T, J, 3) metres and rotations: (T, J, 4) xyzw, both global; those of the body's joints are read.
    """
    body = np.flatnonzero(skeleton.groups != NO_GROUP)
    number = {int(joint): node for node, joint in enumerate(body)}
    points, joints = [heads[:, body]], body.tolist()
    edges: list[list[int]] = []
    for joint in body:
        above = int(skeleton.parents[joint])
        if above in number:
            # A bone is drawn as what its far joint is; the spine's way to a hip or shoulder belongs to the limb.
            edges.append([number[above], number[int(joint)], *_look(skeleton, int(joint))])
    head = _head(skeleton)
    for joint in _last_joints(skeleton, body, head):
        tips = Rotation.from_quat(rotations[:, joint]).apply(skeleton.tails[joint])
        points.append((heads[:, joint] + tips)[:, None])
        joints.append(joint)
        edges.append([number[joint], len(body) + len(points) - 2, *_look(skeleton, joint, ball=joint == head)])
    return StickFigure(np.concatenate(points, axis=1), edges, number[int(skeleton.root)], np.array(joints, np.int64))


def _last_joints(skeleton: Skeleton, body: np.ndarray, head: int | None) -> list[int]:
    """Joints whose bone's tip is not another joint; the head's is drawn though eyes hang on it."""
    carrying = set(skeleton.parents.tolist()) - {head}
    lengths = np.linalg.norm(skeleton.tails, axis=1)
    return [int(joint) for joint in body if int(joint) not in carrying and lengths[joint] > LEAST_BONE_M]


def _look(skeleton: Skeleton, joint: int, *, ball: bool = False) -> list[int]:
    """Body group, 1 for a thin bone (a finger), 1 for the bone that carries the head's ball."""
    # An unsampled joint that carries the body on, such as a zero-length hip, is not a finger.
    sampled = skeleton.sampled[joint] or any(skeleton.sampled[child] for child in _below(skeleton, joint))
    return [int(skeleton.groups[joint]), int(not sampled), int(ball)]


def _head(skeleton: Skeleton) -> int | None:
    """The joint that carries the head, by name: the head, or a neck that nothing follows; a robot may have none."""
    names = [name.lower() if skeleton.sampled[j] else "" for j, name in enumerate(skeleton.names)]
    heads = [j for j, name in enumerate(names) if "head" in name]
    necks = [j for j, name in enumerate(names) if "neck" in name and j not in skeleton.parents]
    return next(iter(heads + necks), None)


def _below(skeleton: Skeleton, joint: int) -> Iterator[int]:
    for child in np.flatnonzero(skeleton.parents == joint):
        yield int(child)
        yield from _below(skeleton, int(child))
