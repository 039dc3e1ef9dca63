"""Description of a recording: what was found and with what certainty, as text, numbers and a tree of joints."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from data_schemas.notes import sentences_of
from data_schemas.skeleton import BODY_GROUPS, NO_GROUP, Motion, Skeleton
from stages.inspect.suspicions import suspicions_of
from stages.shared.formats.bvh import BvhFile, BvhJoint
from stages.shared.formats.recording import Recording
from stages.shared.humanoid.anatomy import RigAnatomy, anatomy_of, direction_name
from stages.shared.kinematics.forward_numpy import positions_of

_SHORT = {"Xposition": "x", "Yposition": "y", "Zposition": "z", "Xrotation": "X", "Yrotation": "Y", "Zrotation": "Z"}
_SPACING_S = 0.2
_MOST_POSES = 300
_HOW = {
    "names": "the joints' names", "shape": "the shape of the tree", "pose": "the poses", "map": "the skeleton map",
    "rest pose": "the rest pose", "first pose": "the first pose",
}  # fmt: skip


_REST = {
    "T-pose": "a T-pose", "A-pose": "an A-pose", "arms down": "standing, arms down", "arms up": "standing, arms up",
    "standing": "standing", "no human pose": "no human pose",
}  # fmt: skip
_WIDE = 116


@dataclass
class Described:
    """lines: for people. tints: line -> its topic, for colours. figures: the same facts as data, for programs."""

    lines: list[str] = field(default_factory=list)
    tints: dict[int, str] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)
    anatomy: RigAnatomy | None = None

    def add(self, line: str, tint: str = "") -> None:
        if tint:
            self.tints[len(self.lines)] = tint
        self.lines.append(line)

    def add_problems(self, problems: list[str], remarks: list[str]) -> None:
        for remark in remarks:
            self.add(f"assumed: {remark}", "faint")
        for problem in problems:
            self.add(f"problem: {problem}", "problem")
        if not problems:
            self.add("No problems found.")
        self.figures |= {"problems": problems, "remarks": remarks}


def describe_recording(
    recording: Recording, bvh: BvhFile | None, *, mapped: bool = False, rate_given: bool = False
) -> Described:
    """A clip on its skeleton.

    Args:
        bvh: the file, if it is a BVH, for its channels.
        mapped: True if the body parts come from a skeleton map of the user's.
        rate_given: True if the frame rate is the user's own.
    """
    skeleton, motion = recording.skeleton, recording.motion
    places = positions_of(skeleton, motion)
    step = max(1, round(_SPACING_S * motion.fps), -(-motion.frames // _MOST_POSES))
    poses = slice(0, None, step)
    anatomy = anatomy_of(
        skeleton, places[poses], motion.rotations[poses].astype(np.float64), step / motion.fps, mapped=mapped
    )
    out = Described(anatomy=anatomy)
    channels = sum(len(joint.channels) for joint in bvh.joints) if bvh else None
    frames = bvh.frames if bvh else motion.frames
    out.add(_size_line(recording.part, skeleton.joints, channels, frames, motion.fps))
    placed = _placed(skeleton, motion, bvh)
    for line in _body_lines(skeleton, motion, anatomy, placed):
        for part in textwrap.wrap(line, _WIDE, initial_indent="  ", subsequent_indent="    "):
            out.add(part)
    out.figures |= _figures(skeleton, motion, anatomy)
    out.figures |= {"channels": channels, "frames": frames, "seconds": frames / motion.fps}
    out.figures["position_channels"] = [skeleton.names[joint] for joint in placed]
    given = [_channels(joint) for joint in bvh.joints] if bvh else [""] * skeleton.joints
    roles = [_role(skeleton, joint) for joint in range(skeleton.joints)]
    _add_tree(out, skeleton.names, skeleton.parents.tolist(), given, roles)
    problems = list(
        dict.fromkeys(
            [
                *sentences_of(recording.notes),
                *suspicions_of(skeleton, motion, places, anatomy, frames - motion.frames, rate_given=rate_given),
            ]
        )
    )
    out.add_problems(problems, sentences_of(recording.remarks))
    return out


def describe_bare_bvh(bvh: BvhFile, fault: str) -> Described:
    """A BVH whose joints are not those of a humanoid: its tree, its channels and the reason."""
    out = Described()
    channels = sum(len(joint.channels) for joint in bvh.joints)
    fps = 1.0 / bvh.frame_time
    out.add(_size_line("", len(bvh.joints), channels, bvh.frames, fps))
    out.figures |= {
        "joints": len(bvh.joints), "channels": channels, "frames": bvh.frames, "fps": fps,
        "seconds": bvh.frames / fps, "humanoid": False,
    }  # fmt: skip
    names, parents = [joint.name for joint in bvh.joints], [joint.parent for joint in bvh.joints]
    _add_tree(out, names, parents, [_channels(joint) for joint in bvh.joints], [("", "")] * len(names))
    out.add_problems([*sentences_of(bvh.warnings), fault], [])
    return out


def _size_line(part: str, joints: int, channels: int | None, frames: int, fps: float) -> str:
    clip = f"clip {part}: " if part else ""
    columns = f", {channels} channels" if channels is not None else ""
    return f"  {clip}{joints} joints{columns}; {frames} frames at {fps:g} fps, {frames / fps:.2f} seconds"


def _body_lines(skeleton: Skeleton, motion: Motion, anatomy: RigAnatomy, placed: list[int]) -> list[str]:
    names, found = skeleton.names, anatomy.findings
    tracks = [names[joint] for joint in motion.track_joints]
    bones = _bones(skeleton)
    ends = ", ".join(f"{what} {names[joint]}" for what, joint in anatomy.end_effectors.items())
    pairs = ", ".join(f"{names[left]}/{names[right]}" for left, right in anatomy.pairs)
    return [
        f"unit {skeleton.unit_m:g} m, {skeleton.up_axis.upper()} up;"
        f" the joints span {anatomy.stature_m:.2f} m upright",
        f"faces {direction_name(anatomy.facing)} in {_HOW[found['facing'].how]};"
        f" the pose at zero rotations is {_REST[anatomy.rest]}",
        f"pelvis: {names[skeleton.root]}; position channels on: {_named(skeleton, tuple(placed))};"
        f" positions vary on: {', '.join([names[0], *tracks])}",
        f"body groups by {_HOW[found['groups'].how]} (sure: {found['groups'].sure:.2f}),"
        f" left and right by {_HOW[found['sides'].how]} (sure: {found['sides'].sure:.2f})",
        "bones that carry points: " + ", ".join(f"{count} {name}" for name, count in bones.items()),
        f"joints without points: {_named(skeleton, anatomy.unseen)}; outside the body:"
        f" {_named(skeleton, anatomy.outside)}",
        f"end effectors: {ends}",
        f"symmetric pairs: {pairs or 'none'}",
    ]


def _placed(skeleton: Skeleton, motion: Motion, bvh: BvhFile | None) -> list[int]:
    """Joints whose positions are in the file for every frame."""
    if bvh is None:
        return [0, *motion.track_joints.tolist()]
    return [
        j for j, joint in enumerate(bvh.joints) if any(channel.endswith("position") for channel in joint.channels)
    ]


def _named(skeleton: Skeleton, joints: tuple[int, ...], most: int = 12) -> str:
    names = [skeleton.names[joint] for joint in joints]
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "") or "none"


def _bones(skeleton: Skeleton) -> dict[str, int]:
    return {name: int(((skeleton.groups == g) & skeleton.sampled).sum()) for g, name in enumerate(BODY_GROUPS)}


def _figures(skeleton: Skeleton, motion: Motion, anatomy: RigAnatomy) -> dict[str, Any]:
    names = skeleton.names
    return {
        "joints": skeleton.joints,
        "fps": motion.fps,
        "humanoid": True,
        "unit_m": skeleton.unit_m,
        "up_axis": skeleton.up_axis,
        "facing": [round(float(value), 4) for value in anatomy.facing],
        "rest_pose": anatomy.rest,
        "height_m": round(anatomy.stature_m, 3),
        "pelvis": names[skeleton.root],
        "tracks": [names[joint] for joint in motion.track_joints],
        "bones": _bones(skeleton),
        "groups": {n: BODY_GROUPS[g] if g >= 0 else None for n, g in zip(names, skeleton.groups, strict=True)},
        "sampled": [names[joint] for joint in np.flatnonzero(skeleton.sampled)],
        "passes_through": [names[joint] for joint in (*anatomy.unseen, *anatomy.outside)],
        "end_effectors": {what: names[joint] for what, joint in anatomy.end_effectors.items()},
        "pairs": [[names[left], names[right]] for left, right in anatomy.pairs],
        "found": {
            what: {"value": f.value, "how": f.how, "sure": round(f.sure, 3)} for what, f in anatomy.findings.items()
        },
    }


def _add_tree(
    out: Described,
    names: Sequence[str],
    parents: Sequence[int],
    channels: Sequence[str],
    roles: Sequence[tuple[str, str]],
) -> None:
    """One joint per line, children indented, with columns as wide as the names."""
    depth: list[int] = []
    for parent in parents:
        depth.append(0 if parent < 0 else depth[parent] + 1)
    labels = ["  " * (level + 1) + name for level, name in zip(depth, names, strict=True)]
    width = min(max(34, *(len(label) for label in labels)), 80) + 2
    beside = max((len(given) for given in channels), default=0)
    out.add("")
    for label, given, (role, tint) in zip(labels, channels, roles, strict=True):
        out.add(f"{label:<{width}}{given:<{beside + 2 if beside else 0}}{role}".rstrip(), tint)
    out.add("")


def _channels(joint: BvhJoint) -> str:
    return "".join(_SHORT[channel] for channel in joint.channels) or "-"


def _role(skeleton: Skeleton, joint: int) -> tuple[str, str]:
    """A joint's role in pumps, and its body group or "faint" for the colour."""
    if skeleton.groups[joint] == NO_GROUP:
        return "(outside the body)", "faint"
    group = BODY_GROUPS[skeleton.groups[joint]]
    length = float(np.linalg.norm(skeleton.tails[joint]))
    pelvis = ", pelvis" if joint == skeleton.root else ""
    if not skeleton.sampled[joint]:
        return f"{group}{pelvis}, no points", "faint"
    return f"{group}{pelvis}, {length * 100:.1f} cm", group
