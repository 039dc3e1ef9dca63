"""Writing a motion as a BVH file, with the header stored in its skeleton."""

from __future__ import annotations

import re

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_header import POSITION_CHANNELS, HeaderFault, parse_header
from stages.shared.formats.bvh_rows import values_of
from stages.shared.formats.bvh_write import DECIMALS, write_bvh


def template_of(header: str, fps: float, name: str) -> BvhFile:
    """A BVH with this header and one row of zeros. Raises InputError if the header is not that of a BVH."""
    try:
        columns = sum(len(joint.channels) for joint in parse_header(header))
    except HeaderFault as fault:
        raise InputError(f"The skeleton of {name} carries no header of a BVH: {fault.message}.") from None
    newline = "\r\n" if "\r\n" in header else "\n"
    rows = ["MOTION", "Frames: 1", f"Frame Time: {1 / fps:.7f}", " ".join(["0"] * columns), ""]
    return read_bvh((header + newline.join(rows)).encode(), name)


def with_places(header: str, joints: set[int]) -> str:
    """The header with position channels on some more joints; a joint that has no channels at all gets none."""
    having = (joint for joint, each in enumerate(parse_header(header)) if each.channels)

    def channels(found: re.Match[str]) -> str:
        if next(having) not in joints:
            return found[0]
        return f"{found[1]}{int(found[2]) + 3} {' '.join(POSITION_CHANNELS)} "

    return re.sub(r"(\bCHANNELS[ \t]+)(0*[1-6])[ \t]+", channels, header, flags=re.IGNORECASE)


def bvh_of_motion(skeleton: Skeleton, motion: Motion, name: str, *, decimals: int = DECIMALS) -> bytes:
    """The bytes of a BVH of a motion, in the unit and axes of its skeleton's source.

    Raises: InputError if the skeleton has no BVH header.
    """
    template = template_of(skeleton.header, motion.fps, name)
    lacking = {
        int(joint)
        for joint in motion.track_joints
        if not set(POSITION_CHANNELS) & set(template.joints[joint].channels)
    }
    if lacking:  # clips of one skeleton share its header, and not all of them move the same joints
        template = template_of(with_places(skeleton.header, lacking), motion.fps, name)
    return write_bvh(template, values_of(template, skeleton, motion), decimals=decimals)
