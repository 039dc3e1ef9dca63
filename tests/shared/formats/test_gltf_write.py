"""A GLB's skeleton, skin and animation, read back from its raw numbers."""

from __future__ import annotations

import numpy as np
import pygltflib
import pytest

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.gltf_write import glb_of_motion
from stages.shared.formats.source_body import body_of, motion_of_poses
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.glb_reading import read_glb
from tests.shared.humanoid.written_rigs import written_rig


def _motions() -> dict[str, tuple[Skeleton, Motion]]:
    texts = {
        "plain": BvhText(frames=20), "root-above": BvhText(frames=20, above="joint_Root"),
        "z-up": BvhText(frames=20, z_up=True), "tracks": BvhText(frames=20, placed=("Hips", "Neck", "LeftHand")),
        "no-ends": BvhText(frames=3, end_site=False), "one-frame": BvhText(frames=1),
    }  # fmt: skip
    out = {name: motion_of(read_bvh(text.data(), name))[:2] for name, text in texts.items()}
    fingers = written_rig("mixamo")
    return out | {"fingers": motion_of_poses(body_of(fingers.rig), fingers.poses)[:2]}


MOTIONS = _motions()


@pytest.mark.parametrize("bind", ["rest", "first"])
@pytest.mark.parametrize("name", MOTIONS)
def test_joints_are_where_the_motion_has_them(name: str, bind: str) -> None:
    skeleton, motion = MOTIONS[name]
    glb = read_glb(glb_of_motion(skeleton, motion, "clip", bind=bind))
    (skin,) = glb.document["skins"]
    nodes = glb.document["nodes"]
    assert [nodes[node]["name"] for node in skin["joints"]] == list(skeleton.names)
    times, places, _ = glb.world()
    assert np.allclose(times, np.arange(motion.frames) / motion.fps, atol=1e-5)
    joints = np.array(skin["joints"])
    assert np.abs(places[:, joints] - positions_of(skeleton, motion)).max() < 1e-4
    # The same through the skin: what is bound to a joint moves as the joint moves.
    inverse = glb.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    primitive = glb.document["meshes"][0]["primitives"][0]
    points = glb.accessor(primitive["attributes"]["POSITION"]).astype(float)
    bones, weights = (glb.accessor(primitive["attributes"][what]) for what in ("JOINTS_0", "WEIGHTS_0"))
    assert set(bones[:, 0]) == set(range(len(joints))) and (weights == (1, 0, 0, 0)).all()
    bone = bones[:, 0].astype(int)
    in_bone = np.einsum("vij,vj->vi", inverse[bone][:, :3, :3], points) + inverse[bone][:, :3, 3]
    lengths = np.maximum(np.linalg.norm(skeleton.tails, axis=1), 0.01)
    assert (np.linalg.norm(in_bone, axis=1) < 1.05 * lengths[bone] + 1e-5).all()
    tips = np.abs(in_bone - skeleton.tails[bone]).max(axis=1) < 1e-4
    assert set(bone[tips]) >= set(np.flatnonzero(np.linalg.norm(skeleton.tails, axis=1) > 0.02))


def test_a_skin_that_is_bound_at_rest_stands_upright_while_nothing_plays() -> None:
    skeleton, motion = MOTIONS["z-up"]
    glb = read_glb(glb_of_motion(skeleton, motion, "clip", bind="rest"))
    points = glb.accessor(glb.document["meshes"][0]["primitives"][0]["attributes"]["POSITION"])
    assert np.ptp(points[:, 1]) > 1.4 > 0.5 > np.ptp(points[:, 2])


def test_faces_look_outward() -> None:
    skeleton, motion = MOTIONS["fingers"]
    glb = read_glb(glb_of_motion(skeleton, motion, "clip"))
    attributes = glb.document["meshes"][0]["primitives"][0]["attributes"]
    points, normals = (glb.accessor(attributes[what]).astype(float) for what in ("POSITION", "NORMAL"))
    faces = points.reshape(-1, 3, 3)
    across = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    assert ((across * normals[::3]).sum(-1) > 0).all()  # wound as the normals say
    middle = points.reshape(skeleton.joints, 24, 3).mean(axis=1).repeat(8, axis=0)
    assert (((faces.mean(axis=1) - middle) * across).sum(-1) > 0).all()


def test_another_library_reads_it_and_bytes_are_reproducible() -> None:
    skeleton, motion = MOTIONS["plain"]
    data = glb_of_motion(skeleton, motion, "clip", licence="CC0")
    assert data == glb_of_motion(skeleton, motion, "clip", licence="CC0")
    loaded = pygltflib.GLTF2.load_from_bytes(data)
    assert loaded is not None and loaded.asset.copyright == "CC0" and loaded.asset.version == "2.0"
    assert len(loaded.skins[0].joints) == skeleton.joints and loaded.animations[0].name == "clip"
    assert {channel.target.path for channel in loaded.animations[0].channels} == {"translation", "rotation"}
