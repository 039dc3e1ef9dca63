"""The skeleton of a skinned body, and motions on its bones.

A body rests at zero rotations, so its bones' global rotations are those of a Motion of its skeleton.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from data_schemas.skinned_body import Body, Skin
from stages.shared.formats.recording import Asked, recording_of
from stages.shared.formats.source_body import SourcePoses, SourceRig
from stages.shared.humanoid.retargeting import retarget
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.rotations import CONJUGATE, continuous_signs, multiply, rotate

_FPS = 30.0


@dataclass(frozen=True)
class BodyRig:
    """A body as a skeleton.

    skeleton: its joints, in an order of their own. joints: (J,) for each bone of the skin, its joint.
    root: the bone of the pelvis. heads: (J, 3) metres, the bones' heads at rest.
    """

    skeleton: Skeleton
    joints: np.ndarray
    root: int
    heads: np.ndarray

    def on_bones(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (T, J, 4) and heads (T, J, 3) of the skin's bones in a motion of the skeleton."""
        return motion.rotations[:, self.joints], positions_of(self.skeleton, motion)[:, self.joints]

    def motion_of(self, rotations: np.ndarray, heads: np.ndarray, fps: float) -> Motion:
        """The reverse of `on_bones`."""
        places = np.empty_like(self.joints)
        places[self.joints] = np.arange(len(self.joints))
        return Motion(continuous_signs(rotations[:, places]), heads[:, places[0]].astype(np.float32), fps)

    def without_root(self, rotations: np.ndarray, heads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The poses with the pelvis where and as it is at rest: no path, no heading, no lean (SpecTrHuMS 4.2)."""
        back = (rotations[:, [self.root]] * CONJUGATE).astype(np.float64)
        turned = multiply(back, rotations.astype(np.float64))
        moved = rotate(back, heads - heads[:, [self.root]].astype(np.float64))
        turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
        return continuous_signs(turned).astype(np.float32), (moved + self.heads[self.root]).astype(np.float32)


def rig_of_body(skin: Skin, body: Body) -> BodyRig:
    """The skeleton of a body. Raises InputError if its bones are not those of a humanoid."""
    offsets = body.heads.copy()
    offsets[1:] -= body.heads[skin.parents[1:]]
    leaves = sorted(set(range(len(skin.names))) - set(skin.parents.tolist()))
    ends = np.zeros_like(offsets)
    for leaf in leaves:
        # A leaf of no stated length continues its parent by half.
        ends[leaf] = 0.5 * offsets[leaf]
    rig = SourceRig(
        names=skin.names,
        parents=tuple(int(parent) for parent in skin.parents),
        offsets=_places(offsets),
        end_sites=_places(ends),
        placed=tuple(bone == 0 for bone in range(len(skin.names))),
        unit_m=1.0,
        up_axis="y",
    )
    still = np.zeros((1, len(skin.names), 4))
    still[..., 3] = 1.0
    standing = recording_of("the body", rig, SourcePoses(local=still, root=body.heads[[0]], fps=_FPS), Asked())
    joints = np.array([standing.skeleton.names.index(name) for name in skin.names])
    root = int(np.flatnonzero(joints == standing.skeleton.root)[0])
    return BodyRig(standing.skeleton, joints, root, body.heads)


def _places(points: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple((x, y, z) for x, y, z in points.tolist())


def put_on_body(source: Skeleton, motion: Motion, rig: BodyRig) -> tuple[np.ndarray, np.ndarray]:
    """A motion of any humanoid on the bones of a body: rotations (T, J, 4) global xyzw, heads (T, J, 3) metres.

    Raises: InputError if the source lacks a limb.
    """
    return rig.on_bones(retarget(source, motion, rig.skeleton).motion)
