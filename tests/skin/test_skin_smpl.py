"""SMPL's parameters as surfaces: against the definition step by step, root and shape, splits, damaged models."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError, UsageError
from data_schemas.mesh import MeshReader
from stages.skin.config import Config
from stages.skin.run import run
from tests.skin.smpl_files import JOINTS, write_model, write_recording

pytest.importorskip("smplx", reason="the extra smplx is not installed")


def _reference(model: dict[str, np.ndarray], pose: np.ndarray, betas: np.ndarray) -> np.ndarray:
    """Loper et al. 2015, eqs. 2-4 and 6-9, joint by joint: (N, 3) without the path."""
    parents = [int(parent) for parent in model["kintree_table"][0]]
    shaped = model["v_template"] + model["shapedirs"] @ betas
    heads = model["J_regressor"] @ shaped
    turns = [Rotation.from_rotvec(vector).as_matrix() for vector in pose.reshape(-1, 3)]
    feature = np.concatenate([(turn - np.eye(3)).ravel() for turn in turns[1:]])
    posed = shaped + model["posedirs"] @ feature
    out = np.zeros_like(posed)
    bones: list[np.ndarray] = []
    for joint, turn in enumerate(turns):
        bone = np.eye(4)
        bone[:3, :3], bone[:3, 3] = turn, heads[joint] - (heads[parents[joint]] if joint else 0)
        bones.append(bone if joint == 0 else bones[parents[joint]] @ bone)
        moved = (posed - heads[joint]) @ bones[joint][:3, :3].T + bones[joint][:3, 3]
        out += model["weights"][:, [joint]] * moved
    return out


def _config(folder: Path, **changed) -> Config:
    given = {"input": folder / "amass", "body_models": folder / "models", "output": folder / "out"}
    return Config.model_validate({**given, **changed})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_model(tmp_path / "models" / "smplh" / "female" / "model.npz")
    return tmp_path


def test_vertices_are_those_of_the_definition(folder: Path):
    model = write_model(folder / "models" / "smplh" / "female" / "model.npz")
    given = write_recording(folder / "amass" / "CMU" / "01" / "01_01_poses.npz")
    report = run(_config(folder, root="kept"))
    assert report.figures["clips"] == 1 and report.figures["frames"] == 20
    with MeshReader(folder / "out") as reader:
        (row,) = reader.clips
        assert row.clip == "amass.CMU.01.01_01_poses" and not reader.is_skinned(row.clip)
        made = reader.vertices(row.clip)
        for frame in (0, 7, 19):
            expected = _reference(model, given["poses"][frame], given["betas"]) + given["trans"][frame]
            expected = np.stack([expected[:, 0], expected[:, 2], -expected[:, 1]], axis=1)  # Z up to Y up
            assert np.abs(made[frame] - expected).max() < 1e-5
        assert len(reader.topology.joints.names) == 22
        places = reader.topology.joints.matrix(reader.topology.count) @ made[0]
        assert places[15, 1] - places[10, 1] > 1.2  # from a foot to the head
        body = reader.body(row.skeleton)
        assert np.abs(body.vertices - (model["v_template"] + model["shapedirs"] @ given["betas"])).max() < 1e-5


def test_without_root_and_on_the_mean_body(folder: Path):
    model = write_model(folder / "models" / "smplh" / "neutral" / "model.npz", seed=3)
    given = write_recording(folder / "amass" / "a.npz")
    run(_config(folder, shape="mean"))
    pose = given["poses"][5].copy()
    pose[:3], pose[66:] = 0, 0
    with MeshReader(folder / "out") as reader:
        made = reader.vertices(reader.clips[0].clip)
        assert np.abs(made[5] - _reference(model, pose, np.zeros(16))).max() < 1e-5


def test_recordings_of_a_shape_share_a_body_and_splits_are_the_papers(folder: Path):
    for name in ("CMU/a_poses.npz", "CMU/b_poses.npz", "BioMotionLab_NTroje/c_poses.npz", "SFU/d_poses.npz"):
        write_recording(folder / "amass" / name, seed=4 if name.startswith("CMU") else 5)
    np.savez(folder / "amass" / "CMU" / "shape.npz", betas=np.zeros(16))
    (folder / "splits.json").write_text(json.dumps({"train": ["CMU"], "test": ["BMLrub"]}))
    report = run(_config(folder, splits=folder / "splits.json"))
    assert any("1 of 5 files are in no split" in line for line in report.lines)
    assert sum(line.startswith("left out") and "shape.npz" in line for line in report.lines) == 1
    assert report.figures["left_out"] == 1
    with MeshReader(folder / "out") as reader:
        assert [(row.split, row.skeleton) for row in reader.clips] == [
            ("test", "body-0"), ("train", "body-1"), ("train", "body-1"),
        ]  # fmt: skip


def test_bad_models_and_options_are_refused_with_one_sentence(folder: Path):
    write_recording(folder / "amass" / "a.npz")
    path = folder / "models" / "smplh" / "female" / "model.npz"
    with pytest.raises(UsageError, match="give neither --bodies nor --where nor an artefact"):
        run(_config(folder, where="seconds > 1"))
    with pytest.raises(UsageError, match="--splits is for --body-models"):
        run(_config(folder, body_models=None, splits=folder / "x.json"))
    with pytest.raises(InputError, match="has no smplh body model for the gender female"):
        run(_config(folder, body_models=folder / "amass"))
    write_model(path, weights=np.ones((5, JOINTS)))
    with pytest.raises(InputError, match="weights has the shape"):
        run(_config(folder))
    write_model(path, v_template=np.array(1.0))
    with pytest.raises(InputError, match="no vertices or no joints"):
        run(_config(folder))
    write_model(path, J_regressor=np.zeros((0, 4 * JOINTS)))
    with pytest.raises(InputError, match="no vertices or no joints"):
        run(_config(folder))
    write_model(path, posedirs=np.full((4 * JOINTS, 3, 9 * (JOINTS - 1)), np.nan))
    with pytest.raises(InputError, match="posedirs holds numbers that are not finite"):
        run(_config(folder))
    assert not (folder / "out").exists()
