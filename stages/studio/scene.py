"""What the page draws of a motion: a description as JSON, and its points as 16-bit numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.stick_figure import StickFigure, stick_figure
from stages.shared.inference.constraints.asked import Constraints
from stages.shared.inference.constraints.known_parts import known_parts
from stages.shared.inference.constraints.rig_parts import END_EFFECTORS, end_effector
from stages.shared.kinematics.foot_contacts import detect_contacts, find_feet, has_feet
from stages.shared.kinematics.forward_numpy import positions_of


@dataclass(frozen=True)
class Scene:
    """description: plain data. points: (T, N, 3) int16, little-endian, in steps of `scale` metres around `origin`."""

    description: dict[str, Any]
    points: bytes


def scene_of(path: Path) -> Scene:
    """The scene of a BVH. Raises InputError where it cannot be read."""
    return _scene_of_motion(*_read(path))


def plain_scene_of(path: Path, constraints: str) -> Scene:
    """The scene of the plain interpolation of what constraints keep of a BVH.

    Args:
        constraints: `Constraints` as JSON. Pins, paths and locks are not looked at.

    Raises: UsageError where nothing says which frames are keys; InputError for parts and frames that are not there.
    """
    from stages.shared.kinematics.plain_motion import plain_motion  # it needs torch

    skeleton, motion = _read(path)
    known = known_parts(Constraints.model_validate_json(constraints), skeleton, motion.frames)
    named = np.flatnonzero(known.joints.any(axis=1) | known.position)
    outside = np.ones(motion.frames, bool)
    outside[named[0] : named[-1] + 1] = False  # such frames stay as they are
    joints, position = known.joints | outside[:, None], known.position | outside
    return _scene_of_motion(skeleton, plain_motion(skeleton, motion, joints, position))


def _read(path: Path) -> tuple[Skeleton, Motion]:
    skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), path.name))
    if motion.frames == 0:
        raise InputError("The recording has no frame.")
    return skeleton, motion


def _scene_of_motion(skeleton: Skeleton, motion: Motion) -> Scene:
    figure = stick_figure(skeleton, positions_of(skeleton, motion), motion.rotations)
    origin = figure.ground_centre()
    points, scale = figure.quantised(origin)
    description = {
        "frames": motion.frames,
        "fps": round(float(motion.fps), 6),
        "nodes": points.shape[1],
        "root": figure.root,
        "edges": figure.edges,
        "scale": scale,
        "origin": origin.tolist(),
        "floor": round(figure.floor_m, 4),
        "height": round(figure.height_m, 4),
        "size": round(figure.size_m, 4),
        "ends": _ends(skeleton, figure),
        "contacts": _contacts(skeleton, motion, figure),
    }
    return Scene(description, points.tobytes())


def _ends(skeleton: Skeleton, figure: StickFigure) -> dict[str, int]:
    """End effectors that can be pinned, and the points nearest to them."""
    found = {}
    for name in END_EFFECTORS:
        try:
            end = end_effector(skeleton, name, "pin")
        except InputError:
            continue
        nodes = np.flatnonzero(figure.joints == end.joint)
        if len(nodes):
            found[name] = int(nodes[0] if end.is_head else nodes[-1])
    return found


def _contacts(skeleton: Skeleton, motion: Motion, figure: StickFigure) -> list[dict[str, Any]]:
    """Where feet stand: of each contact joint its point, and first and last frame of each time."""
    if not has_feet(skeleton) or motion.frames < 2:
        return []
    feet = find_feet(skeleton)
    standing = detect_contacts(positions_of(skeleton, motion), feet, motion.fps)
    found = []
    for foot, joint in enumerate(feet.joints.tolist()):
        edges = np.diff(np.pad(standing[:, foot].astype(np.int8), 1))
        runs = np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1]).tolist()
        nodes = np.flatnonzero(figure.joints == joint)
        if len(nodes):
            found.append({"node": int(nodes[0]), "runs": runs})
    return found
