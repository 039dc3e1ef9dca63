"""Landmarks are at the joints that people mean, on rigs of other names, builds and axes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import source_named
from stages.shared.humanoid.landmarks import LANDMARKS, landmarks_of
from stages.shared.kinematics.forward_numpy import positions_of
from tests.docs.pages import ROOT

_WALK = ROOT / "stages" / "shared" / "clips" / "walk.bvh"
_REAL = ROOT.parent / "shared" / "data"


def _posed(path: Path | str):
    found = recordings_in(source_named(str(path)), Asked())[0]
    return found.skeleton, positions_of(found.skeleton, found.motion), found.motion.rotations.astype(float)


def _at(name: str, places: np.ndarray) -> np.ndarray:
    return places[:, LANDMARKS.index(name)]


def test_limbs_are_at_their_joints():
    skeleton, heads, turns = _posed(_WALK)
    found = landmarks_of(skeleton, heads, turns)
    places = found.place(heads, turns)
    for name in ("left_shoulder", "right_elbow", "left_hip", "right_knee", "left_ankle"):
        joint = skeleton.names.index(name)
        np.testing.assert_allclose(_at(name, places), heads[:, joint], atol=1e-6)
    middle = (_at("left_hip", places) + _at("right_hip", places)) / 2
    np.testing.assert_allclose(_at("pelvis", places), middle, atol=5e-3)


def test_a_face_looks_where_the_body_walks():
    skeleton, heads, turns = _posed(_WALK)
    places = landmarks_of(skeleton, heads, turns).place(heads, turns)
    path = heads[-1, skeleton.root] - heads[0, skeleton.root]
    ahead = (_at("nose", places) - _at("head", places)).mean(axis=0)
    assert ahead @ path / np.linalg.norm(ahead) / np.linalg.norm(path) > 0.9
    left = (_at("left_ear", places) - _at("right_ear", places)).mean(axis=0)
    hips = (_at("left_hip", places) - _at("right_hip", places)).mean(axis=0)
    assert left @ hips > 0 and (_at("head_top", places) - _at("nose", places))[:, 1].mean() > 0
    assert ((_at("left_toe", places) - _at("left_heel", places)).mean(axis=0) @ path) > 0


@pytest.mark.parametrize("seed", range(3))
def test_a_turned_scaled_world_turns_and_scales_the_landmarks(seed: int):
    skeleton, heads, turns = _posed(_WALK)
    turn, size = Rotation.from_euler("y", 2.0 * seed + 1), 1.0 + 0.4 * seed
    other = replace(skeleton, offsets=skeleton.offsets * size, tails=skeleton.tails * size)
    moved = turn.apply(heads.reshape(-1, 3)).reshape(heads.shape) * size
    turned = (turn * Rotation.from_quat(turns.reshape(-1, 4))).as_quat().reshape(turns.shape)
    one = landmarks_of(skeleton, heads, turns).place(heads, turns)
    two = landmarks_of(other, moved, turned).place(moved, turned)
    np.testing.assert_allclose(two, turn.apply(one.reshape(-1, 3)).reshape(one.shape) * size, atol=1e-6)


def test_a_rig_without_a_limb_is_refused():
    skeleton, heads, turns = _posed(_WALK)
    groups = np.where(skeleton.groups == 1, -1, skeleton.groups).astype(np.int8)
    names = tuple(name.replace("left_shoulder", "prop").replace("left_elbow", "prop2") for name in skeleton.names)
    with pytest.raises(InputError, match="left arm"):
        landmarks_of(replace(skeleton, groups=groups, names=names), heads, turns)


@pytest.mark.real
@pytest.mark.skipif(not _REAL.is_dir(), reason="there is no ../shared/data")
@pytest.mark.parametrize(
    ("member", "joints"),
    [
        (
            "cmu-dance.zip!cmu-dance/indian/04.bvh",
            {"left_shoulder": "lShldr", "left_wrist": "lHand", "left_hip": "lThigh"},
        ),
        (
            "bandai-namco-1.zip!bandai-namco-1/dataset-1_bow_active_001.bvh",
            {"left_shoulder": "UpperArm_L", "right_elbow": "LowerArm_R", "left_knee": "LowerLeg_L"},
        ),
    ],
)
def test_rigs_of_archives(member: str, joints: dict[str, str]):
    from stages.shared.formats.sources import find_sources

    archive, _, inside = member.partition("!")
    source = next(s for s in find_sources([str(_REAL / archive)]) if s.member.endswith(inside.rsplit("/", 1)[-1]))
    found = recordings_in(source, Asked())[0]
    heads = positions_of(found.skeleton, found.motion)[::50]
    marks = landmarks_of(found.skeleton, heads, found.motion.rotations[::50].astype(float))
    for landmark, joint in joints.items():
        assert found.skeleton.names[marks.bones[LANDMARKS.index(landmark)]] == joint
