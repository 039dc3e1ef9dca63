"""Clouds ride on the bones, at the rate asked for, and the same seed draws the same points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact
from data_schemas.motion import MotionReader
from data_schemas.tpc import TpcReader
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.sample_tpc.config import Config
from stages.sample_tpc.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.bones import body_joints, bone_set
from tests.shared.formats.bvh_texts import BvhText


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("takes")
    (folder / "a.bvh").write_bytes(BvhText(frames=41, frame_time="0.0083333").data())
    (folder / "b.bvh").write_bytes(BvhText(frames=20, above="joint_Root", seed=3).data())
    ingest(IngestConfig(sources=(str(folder),), output=folder / "motion", licence="CC0"))
    return folder / "motion"


def test_transforms_are_the_bones_at_thirty_frames_a_second(motion: Path, tmp_path: Path) -> None:
    run(Config(motion=motion, output=tmp_path / "tpc", points=64))
    with TpcReader(tmp_path / "tpc") as clouds, MotionReader(motion) as motions:
        assert [row.frames for row in clouds.clips] == [11, 20] and {row.fps for row in clouds.clips} == {30.0}
        row = motions.clips[1]
        skeleton = motions.skeleton(row.skeleton)
        heads, rotations = clouds.transforms(row.clip)
        joints = body_joints(skeleton)
        assert np.allclose(heads, positions_of(skeleton, motions.motion(row.clip))[:, joints], atol=1e-6)
        assert np.array_equal(rotations, motions.motion(row.clip).rotations[:, joints])
        bones = clouds.bones(row.skeleton)
        assert bones.parents[0] == -1 and bones.weights.sum() == pytest.approx(1.0)
        lengths = np.linalg.norm(bones.tails, axis=1)
        assert np.allclose(bones.weights, lengths / lengths.sum(), atol=1e-6)
        assert clouds.artefact.manifest.licences == ["CC0"]


def test_baked_clouds_are_the_rigid_ones(motion: Path, tmp_path: Path) -> None:
    run(Config(motion=motion, output=tmp_path / "rigid", points=64, sigma_m=0.03))
    run(Config(motion=motion, output=tmp_path / "dense", points=64, sigma_m=0.03, bake=True))
    with TpcReader(tmp_path / "rigid") as rigid, TpcReader(tmp_path / "dense") as dense:
        for row in rigid.clips:
            points, groups = rigid.points(row.clip, sigma_m=0.03)
            baked, baked_groups = dense.points(row.clip)
            assert dense.layout(row.clip) == "dense" and np.allclose(points, baked, atol=1e-5)
            assert np.array_equal(groups, baked_groups)


def test_the_seed_decides(motion: Path, tmp_path: Path) -> None:
    def digest(name: str, seed: int) -> str:
        run(Config(motion=motion, output=tmp_path / name, points=32, seed=seed))
        return open_artefact(tmp_path / name).manifest.digest

    assert digest("a", 1) == digest("b", 1) != digest("c", 2)


def test_fingers_are_left_out_and_zero_length_joints_that_turn_others_stay() -> None:
    text = BvhText().text()
    text = text.replace("JOINT Neck", "JOINT Twirl\n{\nOFFSET 0 0 0\nCHANNELS 0\n}\nJOINT Neck")
    finger = "JOINT LeftHandIndex\n{\nOFFSET 3 0 0\nCHANNELS 0\nEnd Site\n{\nOFFSET 2 0 0\n}\n}\n"
    start = text.index("End Site", text.index("JOINT LeftHand"))
    end = text.index("}", start) + 1
    text = text[:start] + finger + text[end:]
    skeleton = motion_of(read_bvh(text.encode(), "a"))[0]
    kept = {skeleton.names[joint] for joint in body_joints(skeleton)}
    assert "LeftHandIndex" not in kept and "Twirl" not in kept and "LeftHand" in kept
    bones, joints = bone_set(skeleton, 200, seed=0)
    assert len(joints) == 21 and set(np.unique(bones.point_bones)) <= set(range(21))
    assert np.allclose(bones.tails[[skeleton.names[j] for j in joints].index("LeftHand")], (0.03, 0, 0))
