"""AMASS: every layout, the subject's own joints, missing facts; pickles are never loaded."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.notes import Flag
from data_schemas.skeleton import BODY_GROUPS
from stages.shared.formats.amass import read_amass
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.smpl import LAYOUTS, neutral_joints, parents_of
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.amass_files import STANDING, body_model, new_layout, npz, old_layout, pose_vectors


def _read(data: bytes, **options: object) -> Recording:
    (recording,) = read_amass(data, "walk_poses.npz", Asked(**options))  # type: ignore[arg-type]
    return recording


def _heads(recording: Recording, layout: str) -> np.ndarray:
    """(T, J, 3) of the layout's joints in its own order, in AMASS' world, whose Z is up."""
    names = list(recording.skeleton.names)
    heads = positions_of(recording.skeleton, recording.motion)[:, [names.index(name) for name in LAYOUTS[layout]]]
    return np.stack([heads[..., 0], -heads[..., 2], heads[..., 1]], axis=-1)


def _by_matrices(layout: str, offsets: np.ndarray, pelvis: np.ndarray, vectors: np.ndarray, trans: np.ndarray):
    """The same, one frame and joint after another, as the model's definition has it."""
    parents = parents_of(layout)
    out = np.zeros((len(vectors), len(parents), 3))
    for frame, vector in enumerate(vectors.reshape(len(vectors), -1, 3)):
        turned: list[np.ndarray] = []
        for joint, parent in enumerate(parents):
            own = Rotation.from_rotvec(vector[joint]).as_matrix()
            if parent < 0:
                out[frame, joint] = pelvis + trans[frame]
                turned.append(own)
            else:
                out[frame, joint] = out[frame, parent] + turned[parent] @ offsets[joint]
                turned.append(turned[parent] @ own)
    return out


@pytest.mark.parametrize("layout", ["body", "smpl", "smplh", "smplx"])
def test_joints_of_the_neutral_body(layout: str) -> None:
    recording = _read(old_layout(layout))
    skeleton = recording.skeleton
    rest = neutral_joints(layout)
    trans = np.random.default_rng(1).normal(0, 0.1, (8, 3)) + STANDING
    expected = _by_matrices(layout, np.array(rest.offsets), np.zeros(3), pose_vectors(layout), trans)
    assert np.allclose(_heads(recording, layout), expected, atol=1e-5)
    assert skeleton.up_axis == "y" and skeleton.unit_m == 1 and skeleton.names[skeleton.root] == "pelvis"
    assert recording.motion.fps == 120 and recording.notes == [] and "neutral body" in str(recording.remarks[0])
    counts = np.bincount(skeleton.groups[skeleton.sampled], minlength=len(BODY_GROUPS))
    assert counts[1] == counts[2] >= 3 and counts[3] == counts[4] >= 3 and counts[0] >= 5
    assert not any("index" in n or "eye" in n for n, s in zip(skeleton.names, skeleton.sampled, strict=True) if s)


def test_both_layouts_give_the_same_motion() -> None:
    whole = np.concatenate([pose_vectors("smplx")], axis=1)
    parts, poses = _read(new_layout()), _read(new_layout(poses=whole, root_orient=None, pose_body=None))
    assert np.array_equal(parts.motion.rotations, poses.motion.rotations) and parts.motion.fps == 100
    assert parts.skeleton.names == poses.skeleton.names and len(parts.skeleton.names) == 55
    assert len(_read(new_layout(pose_hand=None, pose_jaw=None, pose_eye=None)).skeleton.names) == 22
    cube = pose_vectors("smplh").reshape(8, 52, 3)
    assert np.array_equal(_read(old_layout(poses=cube)).motion.rotations, _read(old_layout()).motion.rotations)


def test_the_neutral_body_is_a_plausible_person() -> None:
    recording = _read(
        old_layout(poses=np.tile([np.pi / 2, 0, 0] + [0.0] * 153, (3, 1)), trans=np.zeros((3, 3)), frames=3)
    )
    heads = dict(zip(recording.skeleton.names, positions_of(recording.skeleton, recording.motion)[0], strict=True))
    assert heads["head"][1] - heads["left_ankle"][1] == pytest.approx(1.70 - 0.039 * 1.7 - 0.13, abs=0.05)
    for name, place in heads.items():
        if name.startswith("left_"):
            assert np.allclose(heads[name.replace("left_", "right_")], place * [-1, 1, 1], atol=1e-6)
            assert place[0] > 0


@pytest.mark.parametrize(("layout", "file"), [("smplh", "smplh/male/model.npz"), ("smplx", "smplx/SMPLX_FEMALE.npz")])
def test_a_subjects_own_joints(tmp_path: Path, layout: str, file: str) -> None:
    model = body_model(tmp_path / file, layout)
    data = old_layout() if layout == "smplh" else new_layout()
    recording = _read(data, body_models=tmp_path)
    betas = np.random.default_rng(1)
    trans = betas.normal(0, 0.1, (8, 3)) + (STANDING if layout == "smplh" else 0)
    shape = betas.normal(0, 1, 16)
    rest = model["J_regressor"] @ (model["v_template"] + model["shapedirs"] @ shape)
    offsets = rest - rest[np.array(parents_of(layout))]
    expected = _by_matrices(layout, offsets, rest[0], pose_vectors(layout), trans)
    assert np.allclose(_heads(recording, layout), expected, atol=1e-5)
    assert recording.remarks == []


def test_joints_agree_with_the_smplx_package(tmp_path: Path) -> None:
    smplx = pytest.importorskip("smplx")
    import torch

    # The package picks landmarks by vertex numbers of the real meshes, so the made-up one is as large.
    model = body_model(tmp_path / "smpl" / "SMPL_NEUTRAL.npz", "smpl", betas=10, points=6890)
    recording = _read(old_layout("smpl", gender=None, betas=np.arange(10) / 5), body_models=tmp_path)
    layer = smplx.SMPL("", data_struct=smplx.utils.Struct(**model), num_betas=10, batch_size=8)
    vectors = torch.tensor(pose_vectors("smpl"), dtype=torch.float32)
    trans = np.random.default_rng(1).normal(0, 0.1, (8, 3)) + STANDING
    out = layer(
        betas=torch.arange(10)[None].float() / 5, global_orient=vectors[:, :3], body_pose=vectors[:, 3:],
        transl=torch.tensor(trans, dtype=torch.float32), return_verts=False,
    )  # fmt: skip
    assert np.allclose(_heads(recording, "smpl"), out.joints[:, :24].detach().numpy(), atol=1e-4)


def test_missing_facts_are_assumed_and_reported(tmp_path: Path) -> None:
    body_model(tmp_path / "smplh" / "neutral" / "model.npz", "smplh")
    recording = _read(old_layout(gender=None, betas=None, dmpls=None), body_models=tmp_path)
    assert {each.flag for each in recording.remarks} == {Flag.NO_GENDER, Flag.MEAN_BODY}
    assert "trans" in str(_read(old_layout(trans=None)).notes[0])
    assert _read(old_layout(mocap_framerate=None), fps_override=60.0).motion.fps == 60
    for gender in (np.array(b"male"), np.array("b'male'"), np.array(["Male"]), np.array("m")):
        body_model(tmp_path / "smplh" / "male" / "model.npz", "smplh")
        assert _read(old_layout(gender=gender), body_models=tmp_path).remarks == []


def test_pickled_arrays_are_never_loaded(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "sprung",))

    trap = np.array([Trap()], dtype=object)
    body_model(tmp_path / "smplh" / "neutral" / "model.npz", "smplh")
    recording = _read(old_layout(gender=trap), body_models=tmp_path)
    assert "pickled" in str(recording.remarks[0])
    with pytest.raises(InputError, match="neither poses"):
        _read(old_layout(poses=trap))
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"PK\x03\x04 not really", "is not a NumPy archive"),
        (npz(betas=np.zeros(10)), "neither poses, nor root_orient and pose_body, nor global_orient"),
        (old_layout(mocap_framerate=None), "no mocap_framerate"),
        (old_layout(mocap_framerate=np.array(0.0)), "0 frames a second"),
        (old_layout(poses=np.zeros((8, 100))), "100 numbers wide"),
        (old_layout(poses=np.zeros((0, 156))), "expected frames"),
        (old_layout(poses=np.full((8, 156), np.nan)), "not finite in frame 0"),
        (old_layout(poses=np.full((8, 156), "a")), "no numbers"),
        (old_layout(trans=np.zeros((7, 3))), "shape (7, 3)"),
        (new_layout(pose_body=np.zeros((7, 63))), "differ in their number"),
        (new_layout(pose_body=np.zeros((0, 63))), "no frames"),
        (old_layout(poses=np.zeros((0, 52, 3))), "expected frames by numbers"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bad_files_are_refused_with_the_key(data: bytes, says: str) -> None:
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        _read(data)
    assert "walk_poses.npz" in caught.value.message


def test_a_model_that_is_missing_or_damaged(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=re.escape("smplh/male/model.npz nor a variant of its name")):
        _read(old_layout(), body_models=tmp_path)
    path = tmp_path / "smplh" / "male" / "model.npz"
    path.parent.mkdir(parents=True)
    path.write_bytes(npz(v_template=np.zeros((5, 3))))
    with pytest.raises(InputError, match="lacks plain arrays of J_regressor, shapedirs"):
        _read(old_layout(), body_models=tmp_path)
