"""Writing a motion as a BVH file, with the header stored in its skeleton."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_header import POSITION_CHANNELS, ROTATION_CHANNELS, BvhJoint, HeaderFault, parse_header
from stages.shared.formats.bvh_rows import values_of
from stages.shared.formats.bvh_write import DECIMALS, write_bvh
from stages.shared.humanoid.reference_pose import turn_to_y_up
from stages.shared.kinematics.rotations import conjugate, multiply

_TURNS = ("Zrotation", "Xrotation", "Yrotation")
_STILL = 1e-3  # sine of half the angle: less is rounding
_BLANKS_AND_BRACES = re.compile(r"([\s{}])")


def template_of(header: str, fps: float, name: str) -> BvhFile:
    """A BVH with this header and one row of zeros. Raises InputError if the header is not that of a BVH."""
    try:
        columns = sum(len(joint.channels) for joint in parse_header(header))
    except HeaderFault as fault:
        raise InputError(f"The skeleton of {name} carries no header of a BVH: {fault.message}.") from None
    newline = "\r\n" if "\r\n" in header else "\n"
    rows = ["MOTION", "Frames: 1", f"Frame Time: {1 / fps:.7f}", " ".join(["0"] * columns), ""]
    return read_bvh((header + newline.join(rows)).encode(), name)


def with_channels(header: str, places: Collection[int], turns: Collection[int] = ()) -> str:
    """The header with position channels on some more joints, and rotation channels on others.

    A joint without channels gets a line CHANNELS after its OFFSET.
    """
    joints = parse_header(header)
    newline = "\r\n" if "\r\n" in header else "\n"
    parts = _BLANKS_AND_BRACES.split(header)
    words = [index for index, part in enumerate(parts) if part and not part.isspace()]
    opened: list[int] = []  # the joints whose braces are open, -1 for an End Site
    count = at = 0
    while at < len(words):
        begin, word = words[at], parts[words[at]].upper()
        if word in ("ROOT", "JOINT", "END", "ENDSITE"):
            is_joint = word in ("ROOT", "JOINT")
            opened.append(count if is_joint else -1)
            count += is_joint
            while parts[words[at]] != "{":  # a name may have blanks
                at += 1
        elif word == "}":
            opened.pop()
        elif word == "OFFSET":
            at += 3
            if _is_changed(opened[-1], places, turns) and not joints[opened[-1]].channels:
                parts[words[at]] += f"{newline}{_indent(parts, begin)}{_channels(joints, opened[-1], places, turns)}"
        elif word == "CHANNELS":
            at += 1 + int(parts[words[at + 1]])
            if _is_changed(opened[-1], places, turns):
                there = bool(joints[opened[-1]].channels)  # CHANNELS 0 is replaced by the line after OFFSET
                line = _channels(joints, opened[-1], places, turns) if there else ""
                parts[begin : words[at] + 1] = [line, *[""] * (words[at] - begin)]
        at += 1
    return "".join(parts)


def _is_changed(joint: int, places: Collection[int], turns: Collection[int]) -> bool:
    return joint in places or joint in turns


def _channels(joints: Sequence[BvhJoint], joint: int, places: Collection[int], turns: Collection[int]) -> str:
    before, after = POSITION_CHANNELS * (joint in places), _TURNS * (joint in turns)
    channels = (*before, *joints[joint].channels, *after)
    return f"CHANNELS {len(channels)} {' '.join(channels)}"


def _indent(parts: Sequence[str], index: int) -> str:
    """The blanks before a word of a line."""
    start = index
    while start and parts[start - 1] in ("", " ", "\t"):
        start -= 1
    return "".join(parts[start:index])


def bvh_of_motion(skeleton: Skeleton, motion: Motion, name: str, *, decimals: int = DECIMALS) -> bytes:
    """The bytes of a BVH of a motion, in the unit and axes of its skeleton's source.

    Raises: InputError if the skeleton has no BVH header.
    """
    template = template_of(skeleton.header, motion.fps, name)
    # Clips of one skeleton share its header, and not all of them move the same joints.
    places = {int(j) for j in motion.track_joints if not set(POSITION_CHANNELS) & set(template.joints[j].channels)}
    still = [j for j, each in enumerate(template.joints) if not set(ROTATION_CHANNELS) & set(each.channels)]
    turns = {j for j in still if _turns(skeleton, motion, j)}
    if places or turns:
        template = template_of(with_channels(skeleton.header, places, turns), motion.fps, name)
    return write_bvh(template, values_of(template, skeleton, motion), decimals=decimals)


def _turns(skeleton: Skeleton, motion: Motion, joint: int) -> bool:
    """Whether a joint turns against its parent, or joint 0 against the file's world."""
    parent = int(skeleton.parents[joint])
    if parent >= 0:
        above = motion.rotations[:, parent]
    else:
        turn = turn_to_y_up(skeleton.up_axis)
        above = np.array([[0.0, 0.0, 0.0, 1.0]]) if turn is None else turn.as_quat()[None]
    local = multiply(conjugate(above), motion.rotations[:, joint])
    return bool(np.linalg.norm(local[:, :3], axis=1).max() > _STILL)
