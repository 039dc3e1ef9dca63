"""Joint positions as motion: bones point where they were measured, on a rig, a list, or names and parents alone."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.formats.amass import read_amass
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.joint_lists import LISTS
from stages.shared.formats.pointing import pointed_rotations
from stages.shared.formats.positions import read_positions
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.smpl import LAYOUTS
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.amass_files import npz, old_layout
from tests.shared.formats.position_files import NAMES, PLACES, RIG, csv_of_places, npy_of, posed_list, true_places


def _read(data: bytes, **options: object) -> Recording:
    (recording,) = read_positions(data, "walk.csv", Asked(**options))  # type: ignore[arg-type]
    return recording


def _places(recording: Recording, names: tuple[str, ...] | list[str]) -> np.ndarray:
    order = [recording.skeleton.names.index(name) for name in names]
    return positions_of(recording.skeleton, recording.motion)[:, order]


def test_on_a_rig_joints_come_back_where_they_were() -> None:
    names, places, rotations = true_places()
    recording = _read(npy_of(places), rig=RIG.data(), rig_name="rig.bvh")
    assert recording.skeleton.names == names and recording.skeleton.unit_m == pytest.approx(0.01)
    assert np.abs(_places(recording, names) * 100 - places).max() < 0.2  # lengths are rounded, centimetres
    for joint in ("Hips", "Chest"):  # which two bones and more tell whole
        index = names.index(joint)
        turn = Rotation.from_quat(recording.motion.rotations[:, index]).inv() * Rotation.from_quat(
            rotations[:, index]
        )
        assert np.degrees(turn.magnitude()).max() < 0.5


@pytest.mark.parametrize(
    ("joint", "separator"),
    [("{}.{}", ","), ("{}_{}", ";"), ("{} {}", "\t"), ("{}:{}", ","), ("{}({})", ","), ("{}{}", ",")],
)
def test_tables_in_any_spelling_are_the_same(joint: str, separator: str) -> None:
    names, places, _ = true_places()
    recording = _read(
        csv_of_places(list(names), places, joint, separator, fps=50), rig=RIG.data(), rig_name="rig.bvh"
    )
    expected = _read(npy_of(places), rig=RIG.data(), rig_name="rig.bvh", fps_override=50.0)
    assert recording.motion.fps == 50 and recording.notes == []
    assert np.allclose(recording.motion.rotations, expected.motion.rotations, atol=1e-6)


def test_joints_without_measurements_are_stiff() -> None:
    names, places, _ = true_places()
    kept = [i for i, name in enumerate(names) if name not in ("LeftShoulder", "RightShoulder", "Neck", "Spine")]
    recording = _read(csv_of_places([names[i] for i in kept], places[:, kept]), rig=RIG.data(), rig_name="rig.bvh")
    assert recording.skeleton.names == names
    there = ["Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToe", "RightUpLeg", "RightLeg"]
    assert np.abs(_places(recording, there) * 100 - places[:, [names.index(name) for name in there]]).max() < 0.3
    shoulder, chest = (recording.skeleton.names.index(name) for name in ("LeftShoulder", "Chest"))
    assert np.allclose(recording.motion.rotations[:, shoulder], recording.motion.rotations[:, chest], atol=1e-6)


@pytest.mark.parametrize("title", ["smpl22", "h36m17", "kinect25"])
def test_known_lists(title: str) -> None:
    joints = LISTS[title]()
    names = [name for name, *_ in joints]
    rng = np.random.default_rng(0)
    places = posed_list(title, rng, 12)
    recording = _read(npy_of(places), rig_name=title)
    skeleton = recording.skeleton
    assert sorted(skeleton.names) == sorted(names) and skeleton.up_axis == "y"
    assert np.abs(_places(recording, names) - places).max() < 0.01
    by_name = _read(npz(positions=places, names=np.array(names), fps=np.array(25)))
    assert by_name.motion.fps == 25 and by_name.skeleton.names == skeleton.names
    counts = np.bincount(skeleton.groups[skeleton.sampled], minlength=5)
    assert counts[1] == counts[2] > 1 and counts[3] == counts[4] > 1 and counts[0] > 2


def test_amass_and_its_positions_agree() -> None:
    (amass,) = read_amass(old_layout("body"), "a.npz", Asked())
    names = list(LAYOUTS["body"])
    places = _places(amass, names)
    z_up = np.stack([places[..., 0], -places[..., 2], places[..., 1]], axis=-1) * 1000  # millimetres, Z up
    recording = _read(npy_of(z_up.astype(np.float32)), rig_name="smpl22")
    assert recording.skeleton.up_axis == "y" and recording.skeleton.unit_m == pytest.approx(0.001)
    assert np.abs(_places(recording, names) - places).max() < 2e-3


def test_names_and_parents_alone(tmp_path: Path) -> None:
    names, places, _ = true_places()
    parents = motion_of(read_bvh(RIG.data(), "a"))[0].parents
    (tmp_path / "walk.npy").write_bytes(npy_of(places))
    (tmp_path / "walk.json").write_text(json.dumps({"names": names, "parents": parents.tolist(), "fps": 25}))
    report = run(Config(sources=(str(tmp_path),), output=tmp_path / "out", strict=True))
    assert report.figures["files"] == {"ignored": 1, "kept": 1}
    inside = _read(npz(joints=places, joint_names=np.array(names), parents=parents), fps_override=25.0)
    assert np.abs(_places(inside, names) * 100 - places).max() < 0.3


def test_gaps_are_interpolated_and_reported() -> None:
    names, places, _ = true_places()
    holed = places.copy()
    holed[5:7, names.index("LeftHand")] = np.nan
    recording = _read(npy_of(holed), rig=RIG.data(), rig_name="rig.bvh")
    assert any("2 missing places" in str(note) for note in recording.notes) and recording.repaired_frames == 2
    assert np.abs(_places(recording, names) * 100 - places).max() < 6
    holed[:, names.index("LeftHand")] = np.nan
    with pytest.raises(InputError, match="'LeftHand' is missing in 20 of 20"):
        _read(npy_of(holed), rig=RIG.data(), rig_name="rig.bvh")


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_turning_the_places_turns_the_root_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parents = (-1, 0, 1, 1, 0, 0)
    rest = np.array([[0, 0, 0], [0, 1, 0], [1, 0.3, 0], [-1, 0.3, 0.2], [0.2, -1, 0], [0, -0.8, 1.0]])
    places = np.zeros((3, 6, 3))
    for frame in range(3):
        turned = [Rotation.random(random_state=seed + frame)]
        for joint in range(1, 6):
            places[frame, joint] = places[frame, parents[joint]] + turned[parents[joint]].apply(rest[joint])
            turned.append(turned[parents[joint]] * Rotation.from_rotvec(rng.normal(0, 0.5, 3)))
    places += rng.normal(0, 0.02, places.shape)
    turn = Rotation.from_rotvec(rng.normal(0, 1, 3))
    before = pointed_rotations(rest, parents, places, np.ones(6, bool))
    after = pointed_rotations(
        rest, parents, turn.apply(places.reshape(-1, 3)).reshape(places.shape), np.ones(6, bool)
    )
    root = Rotation.from_quat(after[:, 0]) * (turn * Rotation.from_quat(before[:, 0])).inv()
    assert root.magnitude().max() < 1e-3
    assert np.abs((after[:, 1:] * before[:, 1:]).sum(axis=-1)).min() > 1 - 1e-5


def test_a_bone_turned_about_takes_half_a_turn() -> None:
    rest = np.array([[0, 0, 0], [0, 1.0, 0]])
    for aim in ([0, -1.0, 0], [0, 1.0, 0], [1.0, 0, 0]):
        local = pointed_rotations(rest, (-1, 0), np.array([[[0, 0, 0], aim]]), np.ones(2, bool))
        assert np.allclose(Rotation.from_quat(local[0, 0]).apply(rest[1]), aim, atol=1e-9)


@pytest.mark.parametrize(
    ("data", "options", "says"),
    [
        (npy_of(PLACES), {}, "no joint names and parents"),
        (npy_of(PLACES[:, :5]), {"rig": RIG.data(), "rig_name": "rig.bvh"}, "5 joints without names"),
        (npy_of(PLACES), {"rig_name": "h36m17"}, "the list h36m17 has 17"),
        (npy_of(PLACES[..., :2]), {"rig_name": "h36m17"}, "expected frames, joints and 3"),
        (npy_of(PLACES)[:-9], {"rig_name": "h36m17"}, "truncated"),
        (csv_of_places(list(NAMES), PLACES)[:-30], {"rig": RIG.data(), "rig_name": "r"}, "line 21"),
        (csv_of_places(list(NAMES), PLACES).replace(b"Head.z", b"Head.y"), {"rig": RIG.data()}, "twice"),
        (csv_of_places(list(NAMES), PLACES).replace(b"Head.z", b"Hood.z"), {"rig": RIG.data()}, "needs x, y and z"),
        (csv_of_places([f"Hood{i}" for i in range(21)], PLACES), {"rig": RIG.data()}, "no joint 'Hood0', nor 20"),
        (npz(joints=PLACES, names=np.array(["a"])), {"rig": RIG.data(), "rig_name": "r"}, "21 joints but 1 names"),
        (npz(joints=PLACES, names=np.array(NAMES), parents=np.full(21, 3)), {}, "0 roots"),
        (npz(joints=PLACES, names=np.array(NAMES), parents=np.arange(-1, 20) * 0 - 1), {}, "21 roots"),
        (npz(names=np.array(["a"])), {}, "no array of positions"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_bad_files_are_refused(data: bytes, options: dict, says: str) -> None:
    with pytest.raises(InputError, match=re.escape(says)):
        _read(data, **options)
