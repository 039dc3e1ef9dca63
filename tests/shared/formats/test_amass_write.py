"""AMASS-like files, read back with NumPy and SciPy alone; and SMPL's own form where the rig is SMPL's."""

from __future__ import annotations

import io

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.amass import read_amass
from stages.shared.formats.amass_write import NOT_SMPL, amass_of_motion, smpl_layout_of
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.recording import Asked
from stages.shared.formats.smpl import LAYOUTS, neutral_joints, parents_of
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of, motion_of_poses
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.bvh_texts import BvhText


def _places(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """(T, J, 3) joints, Y up, by plain forward kinematics from the file's own arrays."""
    vectors = arrays["poses"].reshape(len(arrays["poses"]), -1, 3)
    turned: list[Rotation] = []
    places = np.zeros_like(vectors)
    for joint, parent in enumerate(arrays["parents"]):
        own = Rotation.from_rotvec(vectors[:, joint])
        turned.append(turned[parent] * own if parent >= 0 else own)
        if parent >= 0:
            places[:, joint] = places[:, parent] + turned[parent].apply(arrays["offsets"][joint])
        else:
            places[:, joint] = arrays["trans"]
    return places[..., [0, 2, 1]] * (1, 1, -1)  # Z up to Y up


def _read(data: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return dict(arrays)


@pytest.mark.parametrize(
    "text",
    [BvhText(frames=9), BvhText(frames=9, above="joint_Root"), BvhText(frames=9, z_up=True)],
    ids=["plain", "root-above", "z-up"],
)
def test_any_rig_is_written_as_what_it_is(text: BvhText) -> None:
    skeleton, motion, _ = motion_of(read_bvh(text.data(), "a"))
    data, notes = amass_of_motion(skeleton, motion, "CC0")
    arrays = _read(data)
    assert str(arrays["surface_model_type"]) == NOT_SMPL and float(arrays["mocap_framerate"]) == 30
    order = [skeleton.names.index(name) for name in arrays["joint_names"].tolist()]
    assert order[0] == skeleton.root
    assert np.abs(_places(arrays) - positions_of(skeleton, motion)[:, order]).max() < 1e-4
    assert bool(notes) == bool(text.above)
    # The project's reader takes the file for the same rig, and not for SMPL's, though it has 22 joints like it.
    (back,) = read_amass(data, "a.npz", Asked())
    assert set(back.skeleton.names) == set(arrays["joint_names"].tolist())
    again = [back.skeleton.names.index(name) for name in arrays["joint_names"].tolist()]
    found = positions_of(back.skeleton, back.motion)[:, again]
    assert np.abs(found - positions_of(skeleton, motion)[:, order]).max() < 1e-4


def _smpl(layout: str, frames: int = 7) -> tuple[Skeleton, Motion]:
    names = LAYOUTS[layout]
    rng = np.random.default_rng(0)
    local = Rotation.from_rotvec(rng.normal(0, 0.3, (frames * len(names), 3))).as_quat()
    rig = SourceRig(
        names, parents_of(layout), neutral_joints(layout).offsets, ((0.0, 0.0, 0.0),) * len(names),
        tuple(joint == 0 for joint in range(len(names))), 1.0, "z",
    )  # fmt: skip
    poses = SourcePoses(local.reshape(frames, -1, 4), rng.normal(0, 1, (frames, 3)), 60.0)
    return motion_of_poses(body_of(rig), poses)[:2]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_smpl_comes_back_as_smpl(layout: str) -> None:
    skeleton, motion = _smpl(layout)
    assert smpl_layout_of(skeleton) == layout
    data, notes = amass_of_motion(skeleton, motion)
    arrays = _read(data)
    assert not notes and "none" not in str(arrays["surface_model_type"])
    assert arrays["poses"].shape == (7, 3 * len(LAYOUTS[layout]))
    assert tuple(arrays["joint_names"].tolist()) == LAYOUTS[layout]
    (back,) = read_amass(data, "a.npz", Asked())
    places = positions_of(skeleton, motion)
    order = [back.skeleton.names.index(name) for name in skeleton.names]
    assert np.abs(positions_of(back.skeleton, back.motion)[:, order] - places).max() < 1e-4
    assert back.motion.fps == 60 and np.abs(_places(arrays) - places).max() < 1e-4


def test_bytes_do_not_depend_on_the_clock() -> None:
    skeleton, motion = _smpl("smpl")
    assert amass_of_motion(skeleton, motion)[0] == amass_of_motion(skeleton, motion)[0]
