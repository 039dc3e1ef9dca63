"""Reading a rig from a file that holds a recording or only a rest pose."""

from __future__ import annotations

from data_schemas.errors import InputError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.sources import source_named
from stages.shared.pointcloud.rig import Rig, rig_of_motion


def rig_of_file(name: str, rest_frame: int | None = None) -> Rig:
    """The rig of a BVH: a file, or an archive's member ("archive.zip!member").

    Args:
        rest_frame: the frame to use as the rest pose; None uses the mean of all frames.
    Raises: InputError if the file is not a BVH of a humanoid.
    """
    source = source_named(name)
    bvh = read_bvh(source.read(), source.name)
    if bvh.frames == 0:
        raise InputError(f"{source.name} has no frame; the rig's pose is read from a frame.", "Add one frame.")
    skeleton, motion, _ = motion_of(bvh, rest_frame=rest_frame)
    return rig_of_motion(skeleton, motion, rest_frame)
