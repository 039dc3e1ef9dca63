"""A rig to put motion on: a skeleton, the pose it has where nothing says otherwise, and the way to pose it.

Only the bones of the body move. The rest pose is the mean over the frames that are given of the rig, each turned to
face one way: a rig's zero pose need not be a human pose, and one good frame is enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.skeleton_text import plain_of_skeleton, skeleton_of_plain
from stages.shared.kinematics.forward import global_rotations, joint_positions, local_rotations, positions_of
from stages.shared.kinematics.rotations import conjugate, continuous_signs, multiply, rotate, unit
from stages.shared.pointcloud.bones import bone_set
from stages.shared.pointcloud.heading import headings_of, yaw_quaternions

_MOST_FRAMES = 64  # more tell nothing new of a rest pose


@dataclass(frozen=True)
class Rig:
    """A skeleton with its rest pose.

    skeleton:     J joints; its header writes files of the rig.
    rest_local:   (J, 4) float32 xyzw, rotations in the parents' frames at rest, the body facing +Z.
    rest_root:    (3,) float32 metres, joint 0 at rest.
    pelvis_moves: True where the file moves the pelvis below a joint 0 that stands still; else joint 0 moves.
    """

    skeleton: Skeleton
    rest_local: np.ndarray
    rest_root: np.ndarray
    pelvis_moves: bool = False

    def is_like(self, other: Rig) -> bool:
        """Whether both have the same joint names and the same bones, to 1 mm."""
        one, two = self.body.tails, other.body.tails
        return (
            self.skeleton.names == other.skeleton.names
            and one.shape == two.shape
            and bool(np.allclose(one, two, atol=1e-3))
        )

    @cached_property
    def body(self) -> RigBody:
        """The bones of the body alone."""
        bones, joints = bone_set(self.skeleton, 0, 0)
        rest = unit(torch.as_tensor(self.rest_local, dtype=torch.float32))
        world = global_rotations(rest, self.skeleton.parents)
        offsets = torch.as_tensor(self.skeleton.offsets[joints], dtype=torch.float32)
        offsets[0] = 0
        return RigBody(
            joints=joints,
            parents=bones.parents.astype(np.int64),
            offsets=offsets,
            tails=torch.from_numpy(bones.tails),
            groups=torch.from_numpy(bones.groups).long(),
            weights=torch.from_numpy(bones.weights),
            rest_world=world[torch.from_numpy(joints)],
            rest_local=rest[torch.from_numpy(joints)],
        )

    def motion(self, pelvis: Tensor, rotations: Tensor, fps: float) -> Motion:
        """The rig's motion of poses of its body; what is not of the body stays as it is at rest.

        Args:
            pelvis: (T, 3) metres. rotations: (T, B, 4) global rotations of the body's bones.
        """
        skeleton, body = self.skeleton, self.body
        rest = torch.as_tensor(self.rest_local, dtype=torch.float32)
        place = {int(joint): bone for bone, joint in enumerate(body.joints)}
        out: list[Tensor] = []
        for joint, parent in enumerate(skeleton.parents):
            if joint in place:
                out.append(rotations[:, place[joint]])
            elif parent < 0:
                out.append(rest[joint].expand(len(rotations), 4))
            else:
                out.append(multiply(out[int(parent)], rest[joint].expand(len(rotations), 4)))
        world = continuous_signs(unit(torch.stack(out, dim=1)))
        roots = torch.as_tensor(self.rest_root, dtype=torch.float32).expand(len(rotations), 3)
        offsets = torch.as_tensor(skeleton.offsets, dtype=torch.float32)
        heads = joint_positions(world, roots, offsets, skeleton.parents)
        moved = pelvis - heads[:, skeleton.root]
        motion = Motion(world.numpy(), (roots + moved).numpy(), fps)
        if not self.pelvis_moves or skeleton.root == 0:
            return motion
        above = int(skeleton.parents[skeleton.root])
        track = rotate(conjugate(world[:, above]), pelvis - heads[:, above])
        joint = np.array([skeleton.root], np.int32)
        return replace(motion, root_positions=roots.numpy().copy(), track_joints=joint, tracks=track[:, None].numpy())

    def plain(self) -> dict[str, Any]:
        """Plain data that `Rig.of_plain` reads."""
        return {
            "skeleton": plain_of_skeleton(self.skeleton),
            "rest_local": np.asarray(self.rest_local, float).tolist(),
            "rest_root": np.asarray(self.rest_root, float).tolist(),
            "pelvis_moves": bool(self.pelvis_moves),
        }

    @staticmethod
    def of_plain(values: Any) -> Rig:
        """The rig that `plain` described. Raises InputError where the values are none."""
        try:
            skeleton = skeleton_of_plain(values["skeleton"])
            rest = np.array(values["rest_local"], np.float32)
            root = np.array(values["rest_root"], np.float32)
            moves = bool(values["pelvis_moves"])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"The rig that is stored is damaged ({error}).", "Train the network again.") from None
        if rest.shape != (skeleton.joints, 4) or root.shape != (3,) or not np.isfinite(rest).all():
            raise InputError("The rig that is stored is damaged: its rest pose is none.", "Train the network again.")
        return Rig(skeleton, rest, root, moves)


@dataclass(frozen=True)
class RigBody:
    """The B bones of the body, the pelvis first, parents before children.

    joints (B,) of the skeleton; parents (B,), -1 for the pelvis; offsets (B, 3) heads in the parents' frames, zero
    for the pelvis; tails (B, 3); groups (B,); weights (B,), 0 for bones that no point sees; rest_world and rest_local
    (B, 4), global and in the parents' frames.
    """

    joints: np.ndarray
    parents: np.ndarray
    offsets: Tensor
    tails: Tensor
    groups: Tensor
    weights: Tensor
    rest_world: Tensor
    rest_local: Tensor


def rig_of_motion(skeleton: Skeleton, motion: Motion, rest_frame: int | None = None) -> Rig:
    """A rig, its rest pose the mean of frames of it, or one of them.

    Raises: InputError where no bone of it can be seen.
    """
    frames = np.unique(np.linspace(0, motion.frames - 1, _MOST_FRAMES).round().astype(int))
    frames = frames if rest_frame is None else np.array([rest_frame])
    some = motion.at(frames)
    local = local_rotations(torch.as_tensor(some.rotations), skeleton.parents)
    root = skeleton.root
    heads = torch.as_tensor(positions_of(skeleton, some))
    body = torch.as_tensor(np.asarray(skeleton.groups) >= 0)
    # One frame at a time: these frames lie far apart, and a heading must not be smoothed over them.
    groups = torch.as_tensor(np.asarray(skeleton.groups))[body].long().expand(len(frames), -1)
    yaw = headings_of(heads[:, None, body], groups)[:, 0]
    if root == 0:
        local[:, 0] = multiply(yaw_quaternions(yaw), local[:, 0])
    else:
        above = torch.as_tensor(some.rotations)[:, int(skeleton.parents[root])]
        facing = multiply(yaw_quaternions(yaw), multiply(above, local[:, root]))
        local[:, root] = multiply(conjugate(above), facing)
    rig = Rig(
        skeleton,
        mean_rotations(local).numpy(),
        np.asarray(motion.root_positions[0], np.float32),
        pelvis_moves=root != 0 and root in motion.track_joints.tolist(),
    )
    _ = rig.body  # refuses a rig that no point can see
    return rig


def mean_rotations(rotations: Tensor) -> Tensor:
    """The mean of rotations (N, ..., 4) over the first axis, by the largest eigenvector of their outer products."""
    outer = (rotations.unsqueeze(-1) * rotations.unsqueeze(-2)).double().mean(0)
    return torch.linalg.eigh(outer).eigenvectors[..., -1].to(rotations.dtype)


def pose_heads(body: RigBody, pelvis: Tensor, rotations: Tensor) -> Tensor:
    """Heads (..., B, 3) of the body's bones from the pelvis (..., 3) and global rotations (..., B, 4)."""
    return joint_positions(rotations, pelvis, body.offsets.to(rotations.device), body.parents)
