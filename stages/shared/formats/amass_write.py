"""Writing AMASS-like .npz: rotation vectors and the pelvis' path, Z up.

For a rig of the SMPL family the poses follow that layout's order, and AMASS' readers can read the file. For any
other rig the same arrays hold its own joints, described by `joint_names`, `parents` and `offsets`;
`surface_model_type` then states that the rig is not SMPL.
"""

from __future__ import annotations

import io
import zipfile

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.smpl import LAYOUTS, neutral_joints, parents_of
from stages.shared.humanoid.reference_pose import turn_to_y_up
from stages.shared.kinematics.forward_numpy import local_rotations_of, positions_of

NOT_SMPL = "none: joint_names, parents and offsets are the rig's own"
_LIKE_SMPL = 0.8  # least cosine between a bone at rest and the same bone of the neutral body
_STILL_M = 1e-3


def smpl_layout_of(skeleton: Skeleton) -> str | None:
    """The SMPL layout that matches a skeleton's names, parents and rest pose; None for any other rig."""
    place = {name: joint for joint, name in enumerate(skeleton.names)}
    for layout, names in LAYOUTS.items():
        if set(names) != set(place):
            continue
        neutral = neutral_joints(layout).offsets
        for joint, (name, parent) in enumerate(zip(names, parents_of(layout), strict=True)):
            above = skeleton.parents[place[name]]
            if (names[parent] if parent >= 0 else "") != (skeleton.names[above] if above >= 0 else ""):
                return None
            mine, theirs = skeleton.offsets[place[name]], np.array(neutral[joint])
            size = np.linalg.norm(mine) * np.linalg.norm(theirs)
            if parent >= 0 and size > 1e-4 and mine @ theirs < _LIKE_SMPL * size and np.linalg.norm(theirs) > 0.2:
                return None
        return layout
    return None


def amass_of_motion(skeleton: Skeleton, motion: Motion, licence: str = "") -> tuple[bytes, list[str]]:
    """The bytes of an AMASS-like file, and what is not written to it, one sentence each."""
    local = local_rotations_of(skeleton, motion)
    local[:, skeleton.root] = motion.rotations[:, skeleton.root]
    pelvis = positions_of(skeleton, motion)[:, skeleton.root]
    z_up = turn_to_y_up("z")
    assert z_up is not None
    local[:, skeleton.root] = (z_up.inv() * Rotation.from_quat(local[:, skeleton.root])).as_quat()
    layout = smpl_layout_of(skeleton)
    order = _body_below_pelvis(skeleton) if layout is None else [skeleton.names.index(n) for n in LAYOUTS[layout]]
    vectors = Rotation.from_quat(local[:, order].reshape(-1, 4)).as_rotvec().reshape(motion.frames, -1)
    place = {joint: index for index, joint in enumerate(order)}
    parents = [place.get(int(skeleton.parents[joint]), -1) for joint in order]
    offsets = skeleton.offsets[order].copy()
    offsets[0] = 0.0
    arrays = {
        "poses": vectors,
        "trans": z_up.inv().apply(pelvis),
        "mocap_framerate": np.float64(motion.fps),
        "gender": np.array("neutral"),
        "betas": np.zeros(16),
        "surface_model_type": np.array({"body": "smplh"}.get(layout, layout) if layout else NOT_SMPL),
        "joint_names": np.array([skeleton.names[joint] for joint in order]),
        "parents": np.array(parents, np.int32),
        "offsets": offsets,
        "ends": np.where(
            np.isin(np.arange(skeleton.joints), skeleton.parents)[order, None], 0.0, skeleton.tails[order]
        ),
        "licence": np.array(licence),
    }
    return _npz(arrays), _left_out(skeleton, motion, order)


def _body_below_pelvis(skeleton: Skeleton) -> list[int]:
    """The pelvis and all joints below it."""
    inside = {skeleton.root}
    for joint in range(skeleton.root + 1, skeleton.joints):
        if int(skeleton.parents[joint]) in inside:
            inside.add(joint)
    return sorted(inside)


def _left_out(skeleton: Skeleton, motion: Motion, order: list[int]) -> list[str]:
    notes = []
    outside = [skeleton.names[joint] for joint in range(skeleton.joints) if joint not in set(order)]
    if outside:
        notes.append(f"Left out the joints that are not below the pelvis: {', '.join(outside[:8])}.")
    stretched = [
        skeleton.names[joint]
        for track, joint in enumerate(motion.track_joints)
        if joint in order[1:] and np.abs(motion.tracks[:, track] - skeleton.offsets[joint]).max() > _STILL_M
    ]
    if stretched:
        notes.append(f"Left out joint translations, which the format cannot store: {', '.join(stretched[:8])}.")
    return notes


def _npz(arrays: dict[str, np.ndarray]) -> bytes:
    """The bytes of a .npz without timestamps: the same arrays give the same bytes."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array, allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, member.getvalue())
    return out.getvalue()
