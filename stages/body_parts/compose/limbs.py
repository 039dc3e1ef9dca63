"""A skeleton with further limbs, and the motion of its joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh_header_write import header_text, plain_names
from stages.shared.formats.recording import joints_depth_first
from stages.shared.humanoid.body_parts import BodyPart
from stages.shared.humanoid.clips_on_rig import RigBodyJoints
from stages.shared.kinematics.forward import global_rotations, joint_positions
from stages.shared.kinematics.rotations import continuous_signs, unit

_UNIT_M = 0.01  # a BVH of centimetres


@dataclass(frozen=True)
class AddedLimb:
    """The joints of a part once more. local (T, K, 4): their rotations, the connectors' included."""

    part: BodyPart
    name: str
    offset_m: tuple[float, float, float]
    local: np.ndarray


def body_with_limbs(
    body: RigBodyJoints, local: np.ndarray, pelvis: np.ndarray, limbs: Sequence[AddedLimb], fps: float
) -> tuple[Skeleton, Motion]:
    """The rig with further limbs, each hanging where the part's first joints hang, and its motion.

    Args:
        local: (T, B, 4) rotations of the body in the parents' frames. pelvis: (T, 3) metres.
    Returns: a skeleton in depth-first order, Y up, with the header of a BVH in centimetres; its joints outside the
        body do not turn. A connector has the body's rotation.
    """
    rig = body.skeleton
    count, frames = rig.joints, len(local)
    names, parents = list(rig.names), rig.parents.tolist()
    offsets, tails = [list(rig.offsets)], [list(rig.tails)]
    groups, sampled = list(rig.groups), list(rig.sampled)
    turns = np.tile(np.array([0, 0, 0, 1], np.float32), (frames, count, 1))
    turns[:, body.joints] = local
    more = [turns]
    for limb in limbs:
        own = body.joints[limb.part.own]
        place = {int(joint): len(names) + index for index, joint in enumerate(own)}
        for joint in own.tolist():
            above = int(rig.parents[joint])
            names.append(f"{rig.names[joint]}_{limb.name}")
            parents.append(place.get(above, above))
            moved = 0.0 if above in place else np.array(limb.offset_m)
            offsets[0].append(rig.offsets[joint] + moved)
            tails[0].append(rig.tails[joint])
            groups.append(rig.groups[joint])
            sampled.append(rig.sampled[joint])
        more.append(limb.local[:, limb.part.connectors :])
    order = joints_depth_first(parents)
    place_of = {joint: index for index, joint in enumerate(order)}
    skeleton = Skeleton(
        names=plain_names([names[joint] for joint in order]),
        parents=np.array([place_of[parents[joint]] if parents[joint] >= 0 else -1 for joint in order], np.int32),
        offsets=np.array(offsets[0])[order],
        tails=np.array(tails[0])[order],
        groups=np.array(groups, np.int8)[order],
        sampled=np.array(sampled, bool)[order],
        root=place_of[rig.root],
        unit_m=_UNIT_M,
    )
    leaves = np.setdiff1d(np.arange(len(order)), skeleton.parents)
    ends = np.zeros((len(order), 3))
    ends[leaves] = skeleton.tails[leaves]
    header = header_text(
        skeleton.names, skeleton.parents.tolist(), (skeleton.offsets / _UNIT_M).tolist(), (ends / _UNIT_M).tolist(),
        [joint == 0 for joint in range(len(order))],
    )  # fmt: skip
    skeleton = replace(skeleton, header=header)
    world = global_rotations(torch.from_numpy(np.concatenate(more, axis=1)[:, order]), skeleton.parents)
    rotations = continuous_signs(unit(world).numpy())
    heads = joint_positions(
        torch.from_numpy(rotations),
        torch.zeros(frames, 3),
        torch.from_numpy(skeleton.offsets).float(),
        skeleton.parents,
    )
    roots = pelvis - heads[:, skeleton.root].numpy()
    return skeleton, Motion(rotations.astype(np.float32), roots.astype(np.float32), fps)
