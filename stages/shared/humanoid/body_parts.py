"""Decompositions of the body into parts, by the project's body groups (de Clermont Gallerande et al. 2025, 3.1-3.2).

A part is one or several body groups. A part without the spine also holds the joint that it hangs on, its connector,
which is the root of the part's own tree and which the spine's part holds too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import BODY_GROUPS
from stages.shared.humanoid.decompositions import DECOMPOSITIONS, PART_NAMES

SPINE = BODY_GROUPS.index("spine")


@dataclass(frozen=True)
class BodyPart:
    """K joints of a body.

    joints:     (K,) indices into the body's joints, ascending, so that parents come before children.
    parents:    (K,) int64 within the part, -1 for the first joint alone.
    connectors: how many of the first joints belong to the part that it hangs on; 0 for a part with the spine, else 1,
                or more where its two limbs hang on different joints of the spine.
    """

    name: str
    joints: np.ndarray
    parents: np.ndarray
    connectors: int

    @property
    def own(self) -> np.ndarray:
        """The joints without the connectors."""
        return self.joints[self.connectors :]


def groups_of_part(name: str) -> tuple[str, ...]:
    """The body groups of a part. Raises UsageError if no decomposition has it."""
    for parts in DECOMPOSITIONS.values():
        if name in parts:
            return parts[name]
    raise UsageError(f"There is no body part {name!r}.", f"Take one of {', '.join(PART_NAMES)}.")


def body_part(name: str, parents: np.ndarray, groups: np.ndarray) -> BodyPart:
    """One part of a body.

    Args:
        parents: (B,) of the body's joints, the pelvis first with -1, parents before children.
        groups: (B,) body group of each.
    Raises: UsageError for an unknown name, InputError if the body has no joint of one of the part's groups.
    """
    numbers = [BODY_GROUPS.index(group) for group in groups_of_part(name)]
    for number in numbers:
        if not (groups == number).any():
            raise InputError(
                f"The rig has no joint of the {BODY_GROUPS[number].replace('_', ' ')}, which the part {name} needs.",
                "Take another rig, or name its joints with --skeleton-map when it is ingested.",
            )
    own = np.flatnonzero(np.isin(groups, numbers))
    shared = [] if SPINE in numbers else _connectors(own, parents)
    joints = np.array([*shared, *own], np.int64)
    place = {int(joint): index for index, joint in enumerate(joints)}
    inside = np.array([place.get(int(parents[joint]), -1) for joint in joints], np.int64)
    inside[0] = -1
    if (inside[1:] < 0).any():
        raise InputError(f"The joints of the part {name} do not hang together on this rig.", "Take another rig.")
    return BodyPart(name, joints, inside, len(shared))


def _connectors(own: np.ndarray, parents: np.ndarray) -> list[int]:
    """The joint that all limbs of a part hang on, then those between it and the limbs, ascending."""
    inside = set(own.tolist())
    above = [int(parents[joint]) for joint in own if int(parents[joint]) not in inside]
    lines = []
    for joint in above:
        line = [joint]
        while parents[line[-1]] >= 0:
            line.append(int(parents[line[-1]]))
        lines.append(line)
    top = max(set(lines[0]).intersection(*lines[1:]))
    return sorted({joint for line in lines for joint in line if joint >= top})
