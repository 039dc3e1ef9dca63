"""A motion written with another rig's header, where the two have the same joints with the same axes."""

from __future__ import annotations

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.bvh_of_motion import template_of
from stages.shared.formats.bvh_rows import values_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.formats.sources import source_named

_SAME_DIRECTION = np.cos(np.deg2rad(10))
_FAULTS_SHOWN = 12


def bvh_on_rig(skeleton: Skeleton, motion: Motion, rig: str, name: str) -> tuple[bytes, list[str]]:
    """The bytes of a BVH with the header of the BVH `rig`, and what differs, a sentence each.

    The rig must have the motion's joints by name, each on the same parent and with its bone in the same direction at
    rest. It may be of other lengths, order, unit, up axis and channels.
    Raises: InputError with every joint that does not correspond.
    """
    source = source_named(rig)
    template = read_bvh(source.read(), source.name)
    theirs, _, _ = motion_of(template)
    index = {joint: at for at, joint in enumerate(skeleton.names)}
    faults = _faults(skeleton, theirs, index)
    if faults:
        shown = "".join(f"\n  {fault}" for fault in faults[:_FAULTS_SHOWN])
        more = f"\n  and {len(faults) - _FAULTS_SHOWN} more" if len(faults) > _FAULTS_SHOWN else ""
        raise InputError(
            f"{source.name} does not correspond to the rig of {name}:{shown}{more}",
            "`pumps retarget` puts a motion on any rig.",
        )
    order = [index[joint] for joint in theirs.names]
    tracked = {int(joint): track for track, joint in enumerate(motion.track_joints)}
    moving = [joint for joint in range(1, theirs.joints) if order[joint] in tracked]
    at = [tracked[order[joint]] for joint in moving]
    moved = Motion(
        motion.rotations[:, order],
        motion.root_positions,
        motion.fps,
        np.array(moving, np.int32),
        motion.tracks[:, at],
    )
    target = template_of(template.header, motion.fps, source.name)
    data = write_bvh(target, values_of(target, theirs, moved))
    return data, _remarks(skeleton, theirs, order, moving, template)


def _faults(skeleton: Skeleton, theirs: Skeleton, index: dict[str, int]) -> list[str]:
    faults = [f"it has no joint {joint}" for joint in skeleton.names if joint not in set(theirs.names)]
    for joint, name in enumerate(theirs.names):
        if name not in index:
            faults.append(f"its joint {name} is not in the motion")
            continue
        mine = index[name]
        parents = [
            rig.names[rig.parents[at]] if rig.parents[at] >= 0 else ""
            for rig, at in ((theirs, joint), (skeleton, mine))
        ]
        if parents[0] != parents[1]:
            faults.append(f"{name} hangs on {parents[0] or 'nothing'} there and on {parents[1] or 'nothing'} here")
            continue
        a, b = theirs.offsets[joint], skeleton.offsets[mine]
        size = float(np.linalg.norm(a) * np.linalg.norm(b))
        if size > 1e-6 and a @ b < _SAME_DIRECTION * size:
            faults.append(f"the bone to {name} points elsewhere at rest: its axes are others")
    return faults


def _remarks(
    skeleton: Skeleton, theirs: Skeleton, order: list[int], moving: list[int], template: BvhFile
) -> list[str]:
    notes = []
    change = np.linalg.norm(theirs.offsets - skeleton.offsets[order], axis=1)
    if change.max() > 1e-3:
        worst = int(change.argmax())
        notes.append(f"Bones have the rig's lengths; {theirs.names[worst]} differs most, by {change[worst]:.3f} m.")
    fixed = [theirs.names[j] for j in moving if not any(c.endswith("position") for c in template.joints[j].channels)]
    if fixed:
        notes.append(f"The rig has no position channels for the moving places of {', '.join(fixed[:8])}.")
    return notes
