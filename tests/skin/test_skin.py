"""`pumps skin`: motions on bodies, here on a man of boxes; on anny's where the package is installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.mesh import MeshReader
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.forward import positions_of
from stages.shared.meshes.linear_views import LinearView
from stages.skin.config import Config
from stages.skin.run import run
from tests.shared.meshes.figures import CLIPS, write_bodies

HAS_ANNY = importlib.util.find_spec("anny") is not None


@pytest.fixture(scope="module")
def bodies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bodies(tmp_path_factory.mktemp("bodies") / "boxes")


def test_bones_are_where_the_motions_joints_are(bodies: Path, tmp_path: Path) -> None:
    report = run(Config(input=CLIPS / "walk.bvh", output=tmp_path / "m", bodies=bodies, root="kept", fps=30.0))
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk.bvh"))
    assert report.figures["clips"] == 1 and report.figures["frames"] == motion.frames
    with MeshReader(tmp_path / "m") as reader:
        _, heads = reader.bones("walk")
        names = reader.topology.skin.names
        order = [names.index(name) for name in skeleton.names]
        apart = heads[:, order] - positions_of(skeleton, motion)
        apart -= apart[:, :1]  # the body's feet are set on the floor
        assert np.abs(apart).max() < 1e-3
        assert "unknown" in reader.artefact.manifest.licences


def test_without_root_the_pelvis_neither_moves_nor_turns(bodies: Path, tmp_path: Path) -> None:
    for root in ("kept", "removed"):
        run(Config(input=CLIPS / "spin.bvh", output=tmp_path / root, bodies=bodies, root=root))
    with MeshReader(tmp_path / "kept") as kept, MeshReader(tmp_path / "removed") as removed:
        rotations, heads = removed.bones("spin")
        assert np.ptp(heads[:, 0], axis=0).max() < 1e-5 and np.abs(rotations[:, 0, :3]).max() < 1e-5
        # It is the same mesh but for a rigid movement of each frame.
        for frame in (0, len(heads) // 2):
            one, other = (each.vertices("spin", frame, frame + 1)[0] for each in (kept, removed))
            lengths = [np.linalg.norm(mesh[:50, None] - mesh[None, ::37], axis=-1) for mesh in (one, other)]
            assert np.abs(lengths[0] - lengths[1]).max() < 1e-4


def test_stored_vertices_are_those_of_the_bones(bodies: Path, tmp_path: Path) -> None:
    for store in ("bones", "float32"):
        run(Config(input=CLIPS / "kick.bvh", output=tmp_path / store, bodies=bodies, store=store))
    with MeshReader(tmp_path / "bones") as one, MeshReader(tmp_path / "float32") as other:
        assert not other.is_skinned("kick")
        assert np.abs(one.vertices("kick") - other.vertices("kick")).max() < 1e-6


def test_regressed_joints_follow_the_bones(bodies: Path, tmp_path: Path) -> None:
    run(Config(input=CLIPS / "kick.bvh", output=tmp_path / "m", bodies=bodies))
    with MeshReader(tmp_path / "m") as reader:
        joints = reader.topology.joints
        assert 10 < len(joints.names) <= len(reader.topology.skin.names)
        found = LinearView(reader, joints.matrix(reader.topology.count)).window("kick")
        bones = [reader.topology.skin.names.index(name) for name in joints.names]
        assert np.linalg.norm(found - reader.bones("kick")[1][:, bones], axis=-1).mean() < 0.01


def test_what_cannot_be_used_is_refused(bodies: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--where chooses clips of an artefact"):
        run(Config(input=CLIPS / "kick.bvh", output=tmp_path / "m", bodies=bodies, where="seconds > 1"))
    (tmp_path / "bad.bvh").write_text("HIERARCHY\n")
    with pytest.raises(InputError):
        run(Config(input=tmp_path / "bad.bvh", output=tmp_path / "m", bodies=bodies))
    assert not (tmp_path / "m").exists()


@pytest.mark.skipif(HAS_ANNY, reason="anny is installed")
def test_without_anny_the_extra_is_named(tmp_path: Path) -> None:
    with pytest.raises(PumpsError, match="package anny") as caught:
        run(Config(input=CLIPS / "kick.bvh", output=tmp_path / "m"))
    assert "pumps[mesh]" in (caught.value.hint or "")


@pytest.mark.skipif(not HAS_ANNY, reason="needs the package anny: pip install 'pumps[mesh]'")
def test_annys_bodies_stand_and_skin_as_anny_does() -> None:
    import torch

    from stages.shared.meshes.anny_bodies import SHAPES, draw_shapes, load_anny
    from stages.shared.meshes.body_rig import rig_of_body
    from stages.shared.meshes.graph import graph_of

    model = load_anny()
    skin = model.topology.skin
    assert skin is not None and model.topology.count > 13_000
    assert graph_of(model.topology.faces, model.topology.count).crowded == 0
    shapes = draw_shapes(3, 0)
    assert draw_shapes(3, 0) == shapes and set(shapes[0]) == set(SHAPES)
    one, other = (model.body(shape) for shape in shapes[:2])
    assert np.abs(one.vertices - other.vertices).max() > 0.01
    body = model.body({})
    assert 1.5 < np.ptp(body.vertices[:, 1]) < 2.1  # it stands along Y
    rig = rig_of_body(skin, body)
    assert skin.names[rig.root].endswith("Hips") and len(set(rig.joints.tolist())) == len(skin.names)
    # The same turn of the left forearm by anny's own skinning.
    from scipy.spatial.transform import Rotation

    from data_schemas.skinned_body import skinned_vertices

    bone = next(at for at, name in enumerate(skin.names) if name.endswith("LeftForeArm"))
    turn = Rotation.from_rotvec((0.3, 0.5, -0.2))
    rotations = np.tile((0.0, 0.0, 0.0, 1.0), (1, len(skin.names), 1))
    heads = body.heads[None].copy()
    below = [at for at in range(len(skin.names)) if _is_below(skin.parents, at, bone)]
    rotations[0, below] = turn.as_quat()
    heads[0, below] = body.heads[bone] + turn.apply(body.heads[below] - body.heads[bone])
    ours = skinned_vertices(skin, body, rotations, heads)[0]
    z_up = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)  # from Y up to anny's axes
    with torch.no_grad():
        coefficients = model._model.get_phenotype_blendshape_coefficients(**dict.fromkeys(SHAPES, 0.5))
        rest = model._model.get_rest_model(coefficients)
        bone_transforms = torch.eye(4, dtype=torch.float64).repeat(1, len(skin.names), 1, 1)
        matrix = torch.from_numpy(z_up @ turn.as_matrix() @ z_up.T)
        head = rest["rest_bone_poses"][0, bone, :3, 3].double()
        bone_transforms[0, below, :3, :3] = matrix
        bone_transforms[0, below, :3, 3] = head - matrix @ head
        theirs = model._model.get_skinned_vertices(
            bone_transforms=bone_transforms.to(rest["rest_vertices"].dtype), rest_vertices=rest["rest_vertices"]
        )[0].numpy()
    assert np.abs(theirs[:, [0, 2, 1]] * (1, 1, -1) - ours).max() < 1e-3


def _is_below(parents: np.ndarray, bone: int, above: int) -> bool:
    while bone >= 0 and bone != above:
        bone = int(parents[bone])
    return bone == above
