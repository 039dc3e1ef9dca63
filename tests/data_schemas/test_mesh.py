"""Mesh artefacts: what goes in comes out, in windows; what does not fit is refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.mesh import MeshReader, MeshWriter
from data_schemas.skinned_body import Topology, bone_matrices, mapped_skin, skinned_vertices
from tests.shared.meshes.shapes import arm, arm_poses, grid


def _row(clip: str, frames: int, body: str = "arm") -> ClipRow:
    return ClipRow(clip, f"a.zip!{clip}", "0" * 64, body, frames, 25.0, frames / 25, "train", "CC0")


def _written(path: Path, frames: int = 30) -> Path:
    topology, body = arm()
    rotations, heads = arm_poses(frames)
    with write_artefact(path, "mesh", stage="skin", config={}) as draft, MeshWriter(draft.folder, topology) as writer:
        writer.add_body("arm", body)
        writer.add_skinned(_row("bones", frames), rotations, heads)
        vertices = skinned_vertices(topology.skin, body, rotations, heads)
        writer.add_dense(_row("dense", frames), [vertices[:7], vertices[7:]])
        writer.add_dense(_row("half", frames), [vertices], np.float16)
    return path


def test_both_layouts_give_the_same_windows(tmp_path: Path) -> None:
    topology, body = arm()
    with MeshReader(_written(tmp_path / "m")) as reader:
        assert np.array_equal(reader.topology.faces, topology.faces) and reader.bodies() == ("arm",)
        assert reader.topology.joints.names == ("elbow",) and reader.is_skinned("bones")
        assert np.array_equal(reader.body("arm").vertices, body.vertices)
        one, other = reader.vertices("bones", 5, 20), reader.vertices("dense", 5, 20)
        assert one.shape == (15, topology.count, 3) and np.abs(one - other).max() < 1e-6
        assert np.abs(reader.vertices("half", 5, 20) - one).max() < 1e-3
        assert not reader.is_skinned("dense")
        with pytest.raises(InputError, match="stored as vertices"):
            reader.bones("dense")


def test_skinning_is_that_of_a_plain_sum_over_bones() -> None:
    topology, body = arm()
    rotations, heads = arm_poses(4)
    made = skinned_vertices(topology.skin, body, rotations, heads)
    weights = topology.skin.dense
    plain = np.zeros_like(made, dtype=float)
    for frame in range(4):
        for bone in range(2):
            turned = Rotation.from_quat(rotations[frame, bone]).apply(body.vertices - body.heads[bone])
            plain[frame] += weights[:, [bone]] * (turned + heads[frame, bone])
    assert np.abs(made - plain).max() < 1e-5


def test_a_linear_map_of_vertices_needs_no_vertices() -> None:
    topology, body = arm()
    rotations, heads = arm_poses(6)
    mapping = np.random.default_rng(0).normal(size=(5, topology.count)).astype(np.float32)
    mapped = np.einsum(
        "tjab,jmb->tma", bone_matrices(body, rotations, heads), mapped_skin(topology.skin, body, mapping)
    )
    direct = np.einsum("mn,tnd->tmd", mapping, skinned_vertices(topology.skin, body, rotations, heads))
    assert np.abs(mapped - direct).max() < 1e-3 * np.abs(direct).max()


def test_meshes_of_another_connectivity_are_refused(tmp_path: Path) -> None:
    with MeshReader(_written(tmp_path / "m")) as reader:
        reader.check_connectivity(reader.connectivity, "weights")
        with pytest.raises(InputError, match="meshes of another connectivity"):
            reader.check_connectivity("0123456789abcdef", "weights")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda v: v[:, :-1], "expected"),
        (lambda v: np.where(np.arange(v.size).reshape(v.shape) == 70, np.nan, v), "not finite in frame 0"),
        (lambda v: v[:5], "has 5 frames of vertices, its row says 10"),
    ],
)
def test_bad_vertices_are_refused_and_the_old_artefact_stays(tmp_path: Path, change, said: str) -> None:
    vertices, faces = grid(6, 6)
    path = _written(tmp_path / "m")
    before = (path / "manifest.json").read_bytes()
    moving = np.repeat(vertices[None], 10, axis=0)
    with (
        pytest.raises(InputError, match=said),
        write_artefact(path, "mesh", stage="x", config={}) as draft,
        MeshWriter(draft.folder, Topology(faces, 36)) as writer,
    ):
        writer.add_dense(_row("flat", 10, ""), [change(moving)])
    assert (path / "manifest.json").read_bytes() == before


@pytest.mark.parametrize(
    ("faces", "said"),
    [
        (np.array([[0, 1, 9]]), "outside 0 to 3"),
        (np.array([[0, 1, 1]]), "names a vertex twice"),
        (np.zeros((0, 3), int), "no triangles"),
    ],
)
def test_bad_triangles_are_refused(tmp_path: Path, faces: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        MeshWriter(tmp_path, Topology(faces, 4))


def test_a_damaged_file_is_one_sentence(tmp_path: Path) -> None:
    path = _written(tmp_path / "m")
    file = next(path.glob("data-*/meshes.h5"))
    with h5py.File(file, "r+") as opened:
        opened["skin/bones"][0, 0] = 99
    with pytest.raises(InputError, match="bone outside 0 to 1"):
        MeshReader(path)


def test_windows_outside_a_clip_are_refused(tmp_path: Path) -> None:
    with MeshReader(_written(tmp_path / "m")) as reader, pytest.raises(InputError, match="outside the clip"):
        reader.vertices("bones", 20, 31)
