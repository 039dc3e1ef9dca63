"""glTF skins as motion: joints are where the nodes put them, all kinds of curve; errors name what is not read."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from data_schemas.errors import InputError
from stages.shared.formats.gltf_motion import read_gltf
from stages.shared.formats.gltf_sampling import Track, sampled
from stages.shared.formats.recording import Asked, Recording
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.gltf_files import NAMES, GltfText, edited

FORMS = {
    "plain": GltfText(),
    "bind-pose": GltfText(bind=True),
    "armature": GltfText(scale=0.01, turn=(-90, 0, 0)),
    "armature-matrix": GltfText(scale=0.01, turn=(-90, 20, 0), matrix=True),
    "base64": GltfText(uri=True),
    "tracks": GltfText(moving=("Hips", "LeftHand", "Neck")),
    "step": GltfText(kind="STEP"),
    "cubic": GltfText(kind="CUBICSPLINE"),
    "scaled-chest": GltfText(joint_scale={"Chest": (1.5, 1.5, 1.5)}),
    "60-fps": GltfText(fps=60.0),
}


def _read(data: bytes, **options: object) -> list[Recording]:
    return read_gltf(data, "walk.glb", Asked(**options))  # type: ignore[arg-type]


def _heads(recording: Recording) -> np.ndarray:
    order = [recording.skeleton.names.index(name) for name in NAMES]
    return positions_of(recording.skeleton, recording.motion)[:, order]


@pytest.mark.parametrize("text", FORMS.values(), ids=FORMS)
def test_joints_are_where_the_nodes_put_them(text: GltfText) -> None:
    (recording,) = _read(text.data())
    assert recording.motion.fps == text.fps and recording.motion.frames == text.frames
    assert np.abs(_heads(recording) - text.heads()).max() < 2e-5
    assert recording.skeleton.unit_m == 1 and recording.skeleton.up_axis == "y" and recording.part == ""
    tracked = [recording.skeleton.names[joint] for joint in recording.motion.track_joints]
    assert sorted(tracked) == sorted(set(text.moving) - {"Hips"})


def test_every_animation_is_a_clip() -> None:
    text = GltfText(parts=("walk", "run", ""))
    recordings = _read(text.data())
    assert [recording.part for recording in recordings] == ["walk", "run", "joint_2"]
    for part, recording in enumerate(recordings):
        assert np.abs(_heads(recording) - text.heads(part)).max() < 2e-5
    assert not np.allclose(_heads(recordings[0]), _heads(recordings[1]), atol=0.01)


def test_sparse_keys_are_sampled_between() -> None:
    text = GltfText(frames=5, fps=2.0)
    (recording,) = _read(text.data())
    assert recording.motion.fps == 30 and recording.motion.frames == 61
    assert np.abs(_heads(recording)[::15] - text.heads()).max() < 2e-5
    (faster,) = _read(GltfText().data(), fps_override=50.0)
    assert faster.motion.fps == 50 and faster.motion.frames == 9


def test_curves_against_scipy() -> None:
    rng = np.random.default_rng(0)
    keys = np.array([0.0, 0.4, 0.5, 1.3])
    times = np.linspace(0, 1.3, 40)
    turns = Rotation.random(4, random_state=1)
    linear = sampled(Track(keys, turns.as_quat(), "LINEAR", 4, "a"), times)
    close = Rotation.from_quat(linear).inv() * Slerp(keys, turns)(times)
    assert close.magnitude().max() < 1e-6
    values, tangents = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    spline = np.stack([tangents, values, tangents], axis=1).reshape(-1, 3)
    cubic = sampled(Track(keys, spline, "CUBICSPLINE", 3, "a"), times)
    assert np.allclose(cubic, CubicHermiteSpline(keys, values, tangents)(times), atol=1e-12)
    step = sampled(Track(keys, values, "STEP", 3, "a"), np.array([-1, 0.39, 0.4, 9]))
    assert np.array_equal(step, values[[0, 0, 1, 3]])


def _loop(scene: dict) -> None:
    scene["nodes"][2]["children"] = [1]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: [s.pop(key) for key in ("skins", "animations")], "no skin and no animated nodes"),
        (lambda s: s.pop("animations"), "no animation"),
        (lambda s: s["nodes"][3].update(scale=[1, 2, 1]), "scaled unevenly"),
        (lambda s: s["nodes"][0].update(scale=[1, 2, 1]), "scaled unevenly"),
        (lambda s: s["nodes"][3].update(rotation=[0, 0, 0, 0]), "zero length"),
        (lambda s: s["nodes"][3].update(rotation=[0, 0, 1]), "4 finite numbers"),
        (_loop, "two parents"),
        (lambda s: s["nodes"][3].update(children=[-1]), "entry -1 of its nodes"),
        (lambda s: s["accessors"][1].update(count=10**9), "beyond its buffer"),
        (lambda s: s["accessors"][1].update(count=0), "impossible count"),
        (lambda s: s["accessors"][1].update(count=4), "9 times but values of the shape (4, 4)"),
        (lambda s: s["accessors"][1].update(componentType=9), "is not a sound glTF"),
        (lambda s: s["accessors"][1].pop("bufferView"), "sparse"),
        (lambda s: s["bufferViews"][1].update(byteLength=10**9), "beyond its buffer"),
        (lambda s: s["buffers"][0].update(uri="walk.bin"), "in another file"),
        (lambda s: s["animations"][0]["samplers"][0].update(interpolation="WAVY"), "WAVY"),
        (lambda s: s["asset"].update(version="1.0"), "is not glTF 2.0"),
        (lambda s: s.update(nodes={}), "must be a list of objects"),
        (lambda s: s["skins"][0].update(joints=["a"]), "entry a of its nodes"),
    ],
)
def test_bad_files_are_refused(change, says: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        _read(edited(GltfText(), change))
    assert "walk.glb" in caught.value.message


def test_a_cut_file_and_a_long_animation() -> None:
    data = GltfText().data()
    with pytest.raises(InputError, match=r"truncated|cut off"):
        _read(data[:-50])
    long = GltfText(frames=2, fps=1 / 30_000)
    with pytest.raises(InputError, match="too long for a file of its size"):
        _read(long.data())
