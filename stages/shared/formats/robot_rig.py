"""From a robot's URDF to a rig, Y up: each joint that turns becomes a joint, fixed links are merged into it.

A robot's axes are X forward, Y to its left, Z up (ROS REP 103); a skeleton's are X to its left, Y up, Z forward.
The change is a cyclic permutation of the components of vectors and quaternions, so no number is rounded.

Most robots have no feet, hands or head that turn. The ends of their bones come from the collision solids, else from
fixed links, else they are 0.1 m in the last bone's direction; a fixed head becomes a joint that stays still.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from stages.shared.formats.hinges import Hinges
from stages.shared.formats.source_body import SourceRig
from stages.shared.formats.sources import source_named
from stages.shared.formats.urdf import Urdf, UrdfJoint, read_urdf, rotation_of
from stages.shared.humanoid.joint_names import sense_of
from stages.shared.humanoid.reference_pose import LEAF_LENGTH_M

FROM_ROBOT = (1, 2, 0)  # components x, y, z of a robot in the order in which a Y-up skeleton has them
TO_ROBOT = (2, 0, 1)
_SHORTEST_END_M = 0.05  # a nearer fixed link or solid does not determine the end of a hand or foot
_SAME_DISTANCE = 0.99
_NECK_BELOW_MASS_M = 0.05
_HEAD_OVER_SHOULDERS = 1.5
_HEAD = "head"
# Place of the head in the chest's frame, metres, for robots whose URDF has the head only as a mesh. It is that of the
# BVH files of this robot, so that both give the same rig.
_KNOWN_HEADS = {"g1": (0.0, 0.0, 0.38)}


@dataclass(frozen=True)
class RobotRig:
    """The joints of a robot: the root, then those that turn, depth first; J of them, M of which have a column.

    source:    the URDF's name, for errors.
    names:     as the URDF has them, without "_joint"; the root is called as its link.
    end_sites: (J, 3) metres, where leaves end.
    angle_names: M names of joints as the URDF has them, in its order: that of the angles in a row.
    hinges:    the joints as a skeleton has them, Y up.
    """

    source: str
    names: tuple[str, ...]
    end_sites: np.ndarray
    angle_names: tuple[str, ...]
    hinges: Hinges

    def source_rig(self) -> SourceRig:
        """The joints as the type of `stages.shared.formats.source_body`."""
        return SourceRig(
            names=self.names,
            parents=tuple(self.hinges.parents.tolist()),
            offsets=tuple((x, y, z) for x, y, z in self.hinges.offsets.tolist()),
            end_sites=tuple((x, y, z) for x, y, z in self.end_sites.tolist()),
            placed=tuple(joint == 0 for joint in range(len(self.names))),
            unit_m=1.0,
            up_axis="y",
        )


@dataclass
class _Part:
    """A link that turns, or the root, with the fixed links attached to it."""

    joint: UrdfJoint | None
    parent: int
    place: np.ndarray  # (3,) in the parent part's frame, robot's axes
    turn: np.ndarray  # (3, 3) at zero angle
    links: list[tuple[str, np.ndarray, np.ndarray]]  # (link, place, turn) in this part's frame, its own first
    end: np.ndarray
    below: int = 0


def robot_named(text: str) -> RobotRig:
    """The robot of a URDF's path ("archive.zip!member" too). Raises InputError if the file is not a URDF."""
    source = source_named(text)
    return robot_rig(source.read(), source.name)


@lru_cache(maxsize=16)
def robot_rig(data: bytes, name: str) -> RobotRig:
    """The joints of a robot's URDF.

    Args:
        data: the file's bytes. name: its name in error messages.
    Raises: InputError naming the file if it is not a URDF, or no joint turns.
    """
    urdf = read_urdf(data, name)
    parts = _parts(urdf, name)
    angles = [joint for joint in urdf.joints if joint.turns and not joint.mimic]
    if not angles:
        raise InputError(f"{name}: none of its joints turns.", "Is it the description of the whole robot?")
    parts = _with_head(urdf, parts)
    _set_ends(urdf, parts)
    places = {joint.name: place for place, joint in enumerate(angles)}
    turning = [part.joint for part in parts]
    hinges = Hinges(
        parents=np.array([part.parent for part in parts]),
        offsets=np.array([part.place for part in parts])[:, FROM_ROBOT],
        at_zero=_quaternions(parts)[:, (*FROM_ROBOT, 3)],
        axes=np.array([joint.axis if joint else (0.0, 0.0, 0.0) for joint in turning])[:, FROM_ROBOT],
        columns=np.array([places[joint.mimic or joint.name] if joint else -1 for joint in turning]),
        leads=np.array([joint is not None and not joint.mimic for joint in turning]),
        factors=np.array([joint.factor if joint else 1.0 for joint in turning]),
        shifts=np.array([joint.shift if joint else 0.0 for joint in turning]),
        limits=np.array([joint.limits for joint in angles]),
    )
    ends = np.array([part.end for part in parts])[:, FROM_ROBOT]
    return RobotRig(name, _names(urdf, parts), ends, tuple(joint.name for joint in angles), hinges)


def _parts(urdf: Urdf, name: str) -> list[_Part]:
    """The root and what turns, depth first in the file's order, with what is fixed to each."""
    root = urdf.root
    while len(urdf.below.get(root, ())) == 1 and urdf.below[root][0].kind == "floating":
        root = urdf.below[root][0].child  # the world, or a simulator's base for the robot
    nowhere, straight = np.zeros(3), np.eye(3)
    parts = [_Part(None, -1, nowhere, straight, [], nowhere)]
    waiting: list[tuple[str, int, np.ndarray, np.ndarray, UrdfJoint | None]] = [(root, 0, nowhere, straight, None)]
    while waiting:
        link, part, place, turn, joint = waiting.pop()
        if joint is not None:
            parts[part].below += 1
            parts.append(_Part(joint, part, place, turn, [], nowhere))
            part, place, turn = len(parts) - 1, nowhere, straight
        parts[part].links.append((link, place, turn))
        for below in reversed(urdf.below.get(link, ())):
            if below.kind == "floating":
                raise InputError(f"{name}: joint '{below.name[:60]}' floats, and only the whole robot may.")
            moves = below if below.turns else None
            at, to = place + turn @ np.array(below.xyz), turn @ np.array(rotation_of(below.rpy))
            waiting.append((below.child, part, at, to, moves))
    return parts


def _with_head(urdf: Urdf, parts: list[_Part]) -> list[_Part]:
    """The parts, and after them a still part for the head if no turning part is a head."""
    if any(part.joint and sense_of(_plain(part.joint.name)).part in ("head", "neck") for part in parts):
        return parts
    known = next((place for robot, place in _KNOWN_HEADS.items() if urdf.name.lower().startswith(robot)), None)
    for index, part in enumerate(parts):
        for link, place, turn in part.links[1:]:
            if sense_of(_plain(link)).part != "head":
                continue
            at = np.array(known) if known else place
            centre = urdf.links[link].mass_centre
            if np.linalg.norm(at) < 2 * _SHORTEST_END_M and centre is not None:
                at = place + turn @ np.array(centre) - (0.0, 0.0, _NECK_BELOW_MASS_M)
            return _appended(parts, index, at)
    chests = [index for index, part in enumerate(parts) if index and part.below >= 2]
    if not chests:
        return parts
    chest = max(chests, key=lambda index: parts[index].below)
    height = np.mean([part.place[2] for part in parts if part.parent == chest])
    return _appended(parts, chest, np.array([0.0, 0.0, _HEAD_OVER_SHOULDERS * height]))


def _appended(parts: list[_Part], chest: int, at: np.ndarray) -> list[_Part]:
    """The parts with a still head on the chest, after all parts below the chest."""
    inside = {chest}
    for index, part in enumerate(parts):
        if part.parent in inside:
            inside.add(index)
    last = max(inside) + 1
    head = _Part(None, chest, at, np.eye(3), [], np.array([0.0, 0.0, LEAF_LENGTH_M]))
    for part in parts[last:]:
        part.parent += part.parent >= last
    parts[chest].below += 1
    return [*parts[:last], head, *parts[last:]]


def _set_ends(urdf: Urdf, parts: list[_Part]) -> None:
    """Ends of the bones of parts without turning children."""
    for part in parts:
        if part.below or part.joint is None:
            continue
        solids = [place + turn @ np.array(p) for link, place, turn in part.links for p in urdf.links[link].solids]
        fixed = [place for _, place, _ in part.links[1:]]
        end = _farthest(solids)
        if end is None:
            end = _farthest(fixed)
        if end is None:
            end = _onward(parts, part)
        part.end = end


def _farthest(points: list[np.ndarray]) -> np.ndarray | None:
    """The middle of the farthest points; None if they are too near to determine an end."""
    if not points:
        return None
    sizes = np.linalg.norm(points, axis=1)
    if sizes.max() < _SHORTEST_END_M:
        return None
    return np.array(points)[sizes >= _SAME_DISTANCE * sizes.max()].mean(axis=0)


def _onward(parts: list[_Part], part: _Part) -> np.ndarray:
    """0.1 m in the direction of the last bone that has a length."""
    turn = np.eye(3)
    while part.parent >= 0:
        turn = part.turn @ turn
        length = float(np.linalg.norm(part.place))
        if length > 1e-6:
            return turn.T @ part.place / length * LEAF_LENGTH_M
        part = parts[part.parent]
    return np.zeros(3)


def _plain(name: str) -> str:
    for end in ("_joint", "_link"):
        name = name.removesuffix(end)
    return name


def _names(urdf: Urdf, parts: list[_Part]) -> tuple[str, ...]:
    names = [_plain(part.joint.name) if part.joint else _HEAD for part in parts]
    names[0] = _plain(parts[0].links[0][0])
    return tuple(names)


def _quaternions(parts: list[_Part]) -> np.ndarray:
    return Rotation.from_matrix(np.array([part.turn for part in parts])).as_quat()
