"""Joint positions in the unit in which the paper on motion concepts is taken to state lambda.

The paper segments HumanAct12, 24 joints at 20 frames a second, and states neither the unit nor the form of its
fitting error. That data set is published in metres, in which a lambda of 100 to 400 would never divide a motion.
Here errors are squared and in centimetres: real motion then has about two transitions a second and mean fitting
errors of some millimetres, beside the paper's 0.89 to 1.22 (Table 2) for the noisier output of depth cameras. Errors
are taken on a body of `STATURE_M` and count as if there were 24 joints and 20 frames a second, so that lambda means
the same on all rigs and at all rates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.anatomy import parts_of_skeleton
from stages.shared.humanoid.body_groups import LEFT_ARM, LEFT_LEG, RIGHT_ARM, RIGHT_LEG
from stages.shared.humanoid.reference_pose import stature_of
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.rotations import turned_about_y

STATURE_M = 1.5  # from the feet to the head's joint, a leg and the trunk: about that of the SMPL body
PAPER_JOINTS = 24
PAPER_FPS = 20.0
_CM = 100.0


@dataclass(frozen=True)
class Body:
    """The joints that concepts are about.

    joints:  (J,) their indices in the skeleton, parents first; the pelvis is the first.
    names:   J names. parents: (J,) int32 within these joints, -1 for the pelvis. groups: (J,) int8 body groups.
    scale:   factor that scales the body to `STATURE_M`.
    """

    joints: np.ndarray
    names: tuple[str, ...]
    parents: np.ndarray
    groups: np.ndarray
    scale: float


def body_of(skeleton: Skeleton) -> Body:
    """The joints of the body that carry points: no fingers, face or twists, and nothing above the pelvis.

    Raises: InputError if the bones of the legs and the trunk have no length.
    """
    inside = skeleton.sampled.copy()
    inside[skeleton.root] = True
    joints = np.flatnonzero(inside)
    joints = np.concatenate([[skeleton.root], joints[joints != skeleton.root]])
    place = {int(joint): at for at, joint in enumerate(joints)}
    parents = np.full(len(joints), -1, np.int32)
    for at, joint in enumerate(joints.tolist()):
        above = int(skeleton.parents[joint])
        while above >= 0 and above not in place:
            above = int(skeleton.parents[above])
        parents[at] = place.get(above, -1) if at else -1
    parents[1:][parents[1:] < 0] = 0
    parts, _, _ = parts_of_skeleton(skeleton)
    stature = stature_of(skeleton.offsets, parts)
    if not stature > 0:
        raise InputError("The bones of the legs and the trunk have no length.", "Is this a humanoid?")
    names = tuple(skeleton.names[joint] for joint in joints)
    return Body(joints, names, parents, skeleton.groups[joints], STATURE_M / stature)


def body_positions(skeleton: Skeleton, motion: Motion, body: Body) -> np.ndarray:
    """(T, J, 3) float64 positions in the world, in metres on the rig itself."""
    return positions_of(skeleton, motion)[:, body.joints]


def fit_features(positions: np.ndarray, scale: float, fps: float) -> np.ndarray:
    """(T, 3 J) features whose squared distances are the paper's fitting errors.

    Args:
        positions: (T, J, 3) metres. scale: of the body (`Body.scale`). fps: frames a second.

    Centimetres on a body of `STATURE_M`, from the pelvis of the first frame (appendix A), times the root of
    (24 / J) (20 / fps).
    """
    counted = np.sqrt(PAPER_JOINTS / positions.shape[1] * PAPER_FPS / fps)
    places = np.asarray(positions, np.float64) - positions[:1, :1]
    return (places * (scale * _CM * counted)).reshape(len(places), -1)


def heading_yaws(positions: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """(T,) radians about Y by which each pose (T, J, 3) must turn to face +Z, its left along +X.

    By the limbs of both sides, on the ground; 0 where no pair of limbs is there or the sides cannot be told apart.
    """
    across = np.zeros((len(positions), 2))
    for left, right in ((LEFT_LEG, RIGHT_LEG), (LEFT_ARM, RIGHT_ARM)):
        if (groups == left).any() and (groups == right).any():
            apart = positions[:, groups == left].mean(axis=1) - positions[:, groups == right].mean(axis=1)
            across += apart[:, (0, 2)]
    return np.arctan2(across[:, 1], across[:, 0])


def relative_poses(positions: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Poses (T, J, 3) with the pelvis at the origin, turned to face +Z: what anchor concepts are clusters of."""
    poses = positions - positions[:, :1]
    return turned_about_y(poses, heading_yaws(poses, groups)[:, None])
