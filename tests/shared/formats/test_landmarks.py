"""Landmarks and markers as places of joints: .trc, MediaPipe's 33, COCO's 17 and Halpe's 26."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.joint_lists import LISTS, MIDPOINTS, measured_joints
from stages.shared.formats.positions import read_positions
from stages.shared.formats.readers import recognise
from stages.shared.formats.recording import Asked, Recording
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.amass_files import npz
from tests.shared.formats.position_files import csv_of_places, npy_of, posed_list
from tests.shared.formats.trc_files import trc_of

FRAMES = 12
LIMBS = [f"{side}_{part}" for side in ("left", "right") for part in ("elbow", "wrist", "knee", "ankle", "hip")]
POSE2SIM = "RHip RKnee RAnkle RBigToe RSmallToe RHeel LHip LKnee LAnkle LBigToe LSmallToe LHeel Neck Head Nose"
POSE2SIM += " RShoulder RElbow RWrist LShoulder LElbow LWrist"


def _landmarks(title: str) -> np.ndarray:
    """(T, K, 3) metres: what a list's data hold of a figure that bends its limbs a little; K in the list's order."""
    places = posed_list(title, np.random.default_rng(0), FRAMES)
    names = [name for name, *_ in LISTS[title]()]
    for joint, (first, second) in MIDPOINTS[title].items():
        wanted = places[:, names.index(joint)]
        middle = (places[:, names.index(first)] + places[:, names.index(second)]) / 2
        for end in (first, second):  # the two lie about the joint that is their midpoint
            below = [i for i, (name, *_) in enumerate(LISTS[title]()) if _hangs_on(title, name, end)]
            places[:, below] += (wanted - middle)[:, None]
    for heel in [name for name in names if name.endswith("heel")]:  # a heel is nearer to its ankle than the toes
        ankle, at = places[:, names.index(heel.replace("heel", "ankle"))], names.index(heel)
        places[:, at] = ankle + 0.3 * (places[:, at] - ankle)
    return places[:, [names.index(name) for name in measured_joints(title)]]


def _hangs_on(title: str, name: str, end: str) -> bool:
    parents = {joint: parent for joint, parent, _ in LISTS[title]()}
    while name and name != end:
        name = parents[name]
    return name == end


def _read(data: bytes, **options: object) -> Recording:
    (recording,) = read_positions(data, "walk", Asked(**options))  # type: ignore[arg-type]
    return recording


def _off_m(recording: Recording, names: list[str], places: np.ndarray) -> float:
    order = [recording.skeleton.names.index(name) for name in names]
    return float(np.linalg.norm(positions_of(recording.skeleton, recording.motion)[:, order] - places, axis=-1).max())


@pytest.mark.parametrize("title", MIDPOINTS)
def test_landmarks_are_read_with_hip_and_neck_as_midpoints(title: str) -> None:
    places, names = _landmarks(title), measured_joints(title)
    by_place = _read(npy_of(places), rig_name=title)
    of = {name: places[:, i] for i, name in enumerate(names)}
    for joint, (first, second) in MIDPOINTS[title].items():
        if joint not in names:
            assert _off_m(by_place, [joint], ((of[first] + of[second]) / 2)[:, None]) < 0.02
    assert _off_m(by_place, LIMBS, np.stack([of[name] for name in LIMBS], axis=1)) < 0.02
    columns = [f"body_{name}" for name in names]
    shuffled = np.random.default_rng(1).permutation(len(names))
    by_name = _read(csv_of_places([columns[i] for i in shuffled], places[:, shuffled], "{}_{}"))
    assert by_name.skeleton.names == by_place.skeleton.names
    assert np.allclose(by_name.motion.rotations, by_place.motion.rotations, atol=1e-5)
    groups = np.bincount(by_place.skeleton.groups[by_place.skeleton.sampled], minlength=5)
    assert groups[1] == groups[2] > 1 and groups[3] == groups[4] > 1 and groups[0] > 1
    assert by_place.skeleton.up_axis == "y"


def test_feet_end_at_the_toes() -> None:
    recording = _read(npy_of(_landmarks("mediapipe33")), rig_name="mediapipe33")
    sampled = {name for name, here in zip(recording.skeleton.names, recording.skeleton.sampled, strict=True) if here}
    assert {"left_toe", "right_toe"} <= sampled and not {"left_heel", "right_heel"} & sampled


def test_a_list_is_named_by_its_count() -> None:
    with pytest.raises(InputError, match="no joint names and parents") as caught:
        _read(npy_of(_landmarks("mediapipe33")))
    assert "mediapipe33" in (caught.value.hint or "") and "coco17" not in (caught.value.hint or "")
    with pytest.raises(InputError) as caught:
        _read(npy_of(_landmarks("coco17")))
    assert "h36m17, coco17" in (caught.value.hint or "")


@pytest.mark.parametrize(("units", "scale"), [("m", 1.0), ("mm", 1000.0), ("cm", 100.0)])
@pytest.mark.parametrize("blank_line", [True, False])
def test_trc(units: str, scale: float, blank_line: bool) -> None:
    places, names = _landmarks("halpe26"), measured_joints("halpe26")
    data = trc_of(names, places * scale, units, blank_line=blank_line)
    chosen = recognise(data, "walk.bin")
    assert chosen is not None and chosen.name == "positions"
    recording = _read(data)
    assert recording.motion.fps == 50 and recording.skeleton.unit_m == pytest.approx(1 / scale)
    assert _off_m(recording, LIMBS, places[:, [names.index(name) for name in LIMBS]]) < 0.02


def test_the_markers_of_pose2sim_are_read_without_a_hip() -> None:
    places, names = _landmarks("halpe26"), measured_joints("halpe26")
    plain = {name.replace("_", ""): i for i, name in enumerate(names)}
    order = [
        plain[{"R": "right", "L": "left"}[each[0]] + each[1:].lower()] if each[1].isupper() else plain[each.lower()]
        for each in POSE2SIM.split()
    ]
    recording = _read(trc_of(POSE2SIM.split(), places[:, order]))
    assert {"hip", "neck", "head", "left_big_toe"} <= set(recording.skeleton.names)
    assert not {"left_eye", "right_ear"} & set(recording.skeleton.names), "what no marker measures is left out"
    assert _off_m(recording, LIMBS, places[:, [names.index(name) for name in LIMBS]]) < 0.02


def test_missing_markers_are_bridged() -> None:
    places = _landmarks("halpe26").repeat(2, axis=0)
    holed = places.copy()
    holed[3, -1] = holed[4, 2] = np.nan
    lines = trc_of(measured_joints("halpe26"), holed).split(b"\r\n")
    lines[9] = lines[9].rstrip(b"\t")  # programs leave out empty cells at the end of a line
    recording = _read(b"\r\n".join(lines))
    assert recording.repaired_frames == 2 and any("2 missing places" in str(note) for note in recording.notes)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ((b"\t26\t", b"\t25\t"), "there are 26 names, and NumMarkers is 25"),
        ((b"\tm\t", b"\tparsec\t"), "Units is 'parsec'"),
        ((b"\r\n50\t", b"\r\n0\t"), "its rate is 0"),
        ((b"right_heel", b"left_heel"), "'left_heel' stands twice"),
        ((b"Frame#", b"Zeit"), "expected Frame#"),
        ((b"\r\n3\t", b"\r\n3\t1.5\t"), "line 9: 81 cells where 80 are expected"),
        ((b"0.02", b"0,02"), r"'0,02\d*' is not a number"),
    ],
)
def test_faults_of_a_trc(change: tuple[bytes, bytes], says: str) -> None:
    data = trc_of(measured_joints("halpe26"), _landmarks("halpe26"))
    assert change[0] in data
    with pytest.raises(InputError, match=says):
        _read(data.replace(*change))


def test_markers_on_the_skin_are_refused_with_the_way_to_go() -> None:
    names = ["R.ASIS", "L.ASIS", "V.Sacral", "R.Knee.Lat", "L.Knee.Lat", "R.Heel", "L.Heel"]
    with pytest.raises(InputError, match="those of no list") as caught:
        _read(trc_of(names, np.random.default_rng(0).normal(size=(3, len(names), 3))))
    assert "Markers on the skin" in (caught.value.hint or "")


def test_arrays_with_names_are_matched() -> None:
    names = [name.title() for name in measured_joints("coco17")]
    recording = _read(npz(positions=_landmarks("coco17"), names=np.array(names), fps=np.array(25)))
    assert "neck" in recording.skeleton.names and recording.motion.fps == 25
