"""Motions as the page holds them: bodies as points and lines, and scenes of several motions side by side."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import NO_GROUP, Skeleton

LARGEST_STEP = 32767  # positions travel as 16-bit numbers, a fraction of a millimetre apart
LEAST_BONE_M = 1e-4


@dataclass(frozen=True)
class Heading:
    """What a scene is called: a title, and in smaller letters a detail, which may be ""."""

    title: str
    detail: str = ""

    @property
    def name(self) -> str:
        """Both in one line."""
        return f"{self.title}: {self.detail}" if self.detail else self.title


def heading_of(given: str) -> Heading:
    """The heading that the user wrote as `TITLE` or `TITLE: DETAIL`."""
    title, _, detail = given.partition(": ")
    return Heading(title, detail)


@dataclass(frozen=True)
class Drawing:
    """A motion as it is drawn: points (T, N, 3) metres in the world, `fps` frames a second; edges [from, to, body
    group, is thin, is head]; the pelvis."""

    name: str
    fps: float
    points: np.ndarray
    edges: list[list[int]]
    root: int


def drawing_of(name: str, skeleton: Skeleton, heads: np.ndarray, rotations: np.ndarray, fps: float) -> Drawing:
    """The body's joints, and the tips of its last bones.

    Args:
        heads: (T, J, 3) metres and rotations: (T, J, 4) xyzw, both global; those of the body's joints are read.
    """
    body = np.flatnonzero(skeleton.groups != NO_GROUP)
    number = {int(joint): node for node, joint in enumerate(body)}
    points = [heads[:, body]]
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
        edges.append([number[joint], len(body) + len(points) - 2, *_look(skeleton, joint, ball=joint == head)])
    return Drawing(name, fps, np.concatenate(points, axis=1), edges, number[int(skeleton.root)])


def scene_of(heading: Heading, keys: Sequence[int] | np.ndarray, drawings: Sequence[Drawing]) -> dict:
    """A scene as plain data for the page; the first motion is the true one, whose frames `keys` were known."""
    first = drawings[0]
    cloud = first.points
    origin = cloud[:, first.root].mean(axis=0) * [1, 0, 1]
    return {
        "name": heading.name,
        "title": heading.title,
        "detail": heading.detail,
        "keys": [int(key) for key in keys if key < len(cloud)],
        "floor": round(float(np.percentile(cloud[..., 1].min(axis=1), 2)), 4),
        "height": round(float(np.percentile(np.ptp(cloud[..., 1], axis=1), 90)), 4),
        "size": round(float(np.percentile(np.ptp(cloud, axis=1).max(axis=1), 90)), 4),
        "motions": [_packed(drawing, origin) for drawing in drawings],
    }


def _packed(drawing: Drawing, origin: np.ndarray) -> dict:
    """A motion as the page holds it, its points around `origin` as 16-bit numbers."""
    cloud = drawing.points - origin
    scale = max(float(np.abs(cloud).max()), 1e-6) / LARGEST_STEP
    return {
        "name": drawing.name,
        "fps": round(float(drawing.fps), 6),
        "frames": cloud.shape[0],
        "nodes": cloud.shape[1],
        "root": drawing.root,
        "edges": drawing.edges,
        "scale": scale,
        "points": base64.b64encode(np.round(cloud / scale).astype("<i2").tobytes()).decode(),
    }


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
