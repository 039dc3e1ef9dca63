"""Tables of positions: columns by name, End Sites, angles, decimal commas, and what is not of the skeleton."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.notes import Flag
from data_schemas.skeleton import Motion
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.joint_matching import end_of, matched, sided_name
from stages.shared.formats.positions import read_positions
from stages.shared.formats.readers import recognise
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.table_columns import Column, column_named, decimal_commas_hint
from stages.shared.formats.table_write import csv_of_motion
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.amass_files import npz
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.position_files import csv_of_places, npy_of

RIG = BvhText(frames=1)
SKELETON, MOTION, _ = motion_of(read_bvh(BvhText(frames=20, seed=3).data(), "truth.bvh"))
NAMES, PARENTS = SKELETON.names, SKELETON.parents.tolist()
PLACES = positions_of(SKELETON, MOTION) * 100  # centimetres


def _read(data: bytes, **options: object) -> Recording:
    (recording,) = read_positions(data, "walk.csv", Asked(**options))  # type: ignore[arg-type]
    return recording


def _error_cm(recording: Recording, names: tuple[str, ...] = NAMES, places: np.ndarray = PLACES) -> float:
    order = [recording.skeleton.names.index(name) for name in names]
    found = positions_of(recording.skeleton, recording.motion)[:, order] * 100
    return float(np.linalg.norm(found - places, axis=-1).max())


def _sidecar(order: list[int]) -> bytes:
    """A JSON of the same joints in another order, parents in that order."""
    place = {joint: at for at, joint in enumerate(order)}
    parents = [place.get(PARENTS[joint], -1) for joint in order]
    return json.dumps({"names": [NAMES[joint] for joint in order], "parents": parents, "fps": 25}).encode()


@pytest.mark.parametrize("seed", range(5))
def test_columns_go_to_the_joints_of_their_names(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, joints = rng.permutation(len(NAMES)), rng.permutation(len(NAMES)).tolist()
    data = csv_of_places([NAMES[i] for i in columns], PLACES[:, columns])
    by_json = _read(data, rig=_sidecar(joints), rig_name="walk.json")
    assert _error_cm(by_json) < 0.1 and by_json.notes == [] and by_json.motion.fps == 25
    by_rig = _read(data, rig=RIG.data(), rig_name="rig.bvh")
    assert _error_cm(by_rig) < 0.3 and [note.flag for note in by_rig.notes] == [Flag.NO_FRAME_RATE]
    arrays = npz(positions=PLACES[:, columns], names=np.array([NAMES[i] for i in columns]))
    assert _error_cm(_read(arrays, rig=_sidecar(joints), rig_name="walk.json")) < 0.1


def test_unmatched_names_are_left_out_and_reported() -> None:
    names = [f"Hat{name}" if name == "Head" else name for name in NAMES]
    for options in (
        {"rig": RIG.data(), "rig_name": "rig.bvh"},
        {"rig": _sidecar(list(range(len(NAMES)))), "rig_name": "walk.json"},
    ):
        recording = _read(csv_of_places(names, PLACES), **options)
        (told,) = [str(note) for note in recording.notes if note.flag is Flag.COLUMNS_LEFT_OUT]
        assert f"{options['rig_name']} has no joint were left out: HatHead; joints without a column: Head." in told
        others = tuple(name for name in NAMES if name != "Head")
        assert _error_cm(recording, others, PLACES[:, [NAMES.index(name) for name in others]]) < 0.3


def test_a_joint_of_a_json_without_a_column_hands_its_children_up() -> None:
    kept = [i for i, name in enumerate(NAMES) if name not in ("Chest", "LeftForeArm")]
    data = csv_of_places([NAMES[i] for i in kept], PLACES[:, kept])
    recording = _read(data, rig=_sidecar(list(range(len(NAMES)))), rig_name="walk.json")
    assert set(recording.skeleton.names) == {NAMES[i] for i in kept}
    spine = recording.skeleton.names.index("Spine")
    assert recording.skeleton.parents[recording.skeleton.names.index("Neck")] == spine


def test_two_columns_of_one_joint_are_not_both_used() -> None:
    data = csv_of_places([*NAMES, "left_hand"], np.concatenate([PLACES, PLACES[:, :1]], axis=1))
    recording = _read(data, rig=RIG.data(), rig_name="rig.bvh")
    assert any("left_hand" in str(note) for note in recording.notes) and _error_cm(recording) < 0.3


def test_columns_of_ends_turn_the_leaves() -> None:
    rig = read_bvh(BvhText(frames=20, seed=3).data(), "truth.bvh")
    leaves = [i for i, joint in enumerate(rig.joints) if joint.end_site is not None]
    sites = np.tile([rig.joints[i].end_site for i in leaves], (len(PLACES), 1))

    def ends_of(motion: Motion) -> np.ndarray:
        return Rotation.from_quat(motion.rotations[:, leaves].reshape(-1, 4)).apply(sites).reshape(len(PLACES), -1, 3)

    names = [*NAMES, *(f"{NAMES[i]}_End" for i in leaves)]
    ends = ends_of(MOTION) + PLACES[:, leaves]
    recording = _read(
        csv_of_places(names, np.concatenate([PLACES, ends], axis=1)), rig=RIG.data(), rig_name="rig.bvh"
    )
    assert recording.skeleton.names == NAMES and [n.flag for n in recording.notes] == [Flag.NO_FRAME_RATE]
    off = np.linalg.norm(ends_of(recording.motion) + PLACES[:, leaves] - ends, axis=-1)
    assert off.max() < 0.02 * np.linalg.norm(sites, axis=1).max()
    own = _read(
        csv_of_places(names, np.concatenate([PLACES, ends], axis=1)),
        rig=_sidecar(list(range(len(NAMES)))),
        rig_name="w.json",
    )
    assert _error_cm(own) < 0.1 and any("Head_End" in str(note) for note in own.notes)


# --- numbers that are no places -----------------------------------------------------------------------


def _angles() -> np.ndarray:
    """(T, J, 3) Euler angles in degrees of the truth, as bvh2csv writes them."""
    local = MOTION.rotations.astype(float)
    parents = np.maximum(SKELETON.parents, 0)
    turned = Rotation.from_quat(local[:, parents].reshape(-1, 4)).inv() * Rotation.from_quat(local.reshape(-1, 4))
    return turned.as_euler("ZXY", degrees=True).reshape(*local.shape[:2], 3)


def test_angles_are_refused() -> None:
    for options in (
        {"rig": RIG.data(), "rig_name": "rig.bvh"},
        {"rig": _sidecar(list(range(len(NAMES)))), "rig_name": "walk.json"},
    ):
        with pytest.raises(InputError, match=r"change their length by \d+%.*not places") as caught:
            _read(csv_of_places(list(NAMES), _angles()), **options)
        assert "angles" in (caught.value.hint or "")


def test_still_angles_are_refused_by_the_rigs_proportions() -> None:
    sizes = np.array([1.0 if name in ("Hips", "Spine", "Chest", "Neck", "Head") else 40.0 for name in NAMES])
    degrees = np.random.default_rng(0).normal(0, 1, (1, len(NAMES), 3)) * sizes[:, None]
    still = np.tile(degrees, (9, 1, 1))
    with pytest.raises(InputError, match="times as long"):
        _read(csv_of_places(list(NAMES), still), rig=RIG.data(), rig_name="rig.bvh")


def test_places_with_the_noise_of_cameras_are_read() -> None:
    noisy = PLACES + np.random.default_rng(0).normal(0, 1.0, PLACES.shape)  # centimetres
    assert _error_cm(_read(csv_of_places(list(NAMES), noisy), rig=RIG.data(), rig_name="rig.bvh")) < 20


@pytest.mark.parametrize("joint", ["{}_rotation_{}", "{}.rot.{}", "{} angle {}", "{}.Euler.{}", "{}_velocity_{}"])
def test_columns_named_as_angles_are_refused_or_left_out(joint: str) -> None:
    with pytest.raises(InputError, match="no column holds a place"):
        _read(csv_of_places(list(NAMES), PLACES, joint), rig=RIG.data())
    tables = [csv_of_places(list(NAMES), PLACES, each).split(b"\n") for each in ("{}.{}", joint)]
    both = b"\n".join(b",".join(lines) for lines in zip(*tables, strict=True))
    recording = _read(both, rig=RIG.data(), rig_name="rig.bvh")
    assert _error_cm(recording) < 0.3
    assert any("63 columns of rotations" in str(note) for note in recording.notes)


def test_a_table_that_pumps_exports_is_read_back() -> None:
    for values in ("positions", "both"):
        data = csv_of_motion(SKELETON, MOTION, values)
        chosen = recognise(data, "out.csv")
        assert chosen is not None and chosen.name == "positions"
        recording = _read(data, rig=RIG.data(), rig_name="rig.bvh")
        assert _error_cm(recording) < 0.3 and recording.motion.fps == pytest.approx(MOTION.fps)


# --- spellings ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("data", [PLACES[None], PLACES[None, None], PLACES.reshape(1, len(PLACES), -1)])
def test_a_leading_axis_of_one_is_dropped(data: np.ndarray) -> None:
    for content in (npy_of(data), npz(positions=data)):
        assert _error_cm(_read(content, rig=RIG.data(), rig_name="rig.bvh")) < 0.3
    with pytest.raises(InputError, match="expected frames, joints and 3"):
        _read(npy_of(np.concatenate([PLACES[None]] * 2)), rig=RIG.data())


def test_decimal_commas_are_named() -> None:
    plain = csv_of_places(list(NAMES), PLACES, fps=25)
    commas = plain.replace(b".", b",")
    head = plain.partition(b"\n")[0]
    with pytest.raises(InputError, match="line 2: 128 cells where there are 64") as caught:
        _read(head + b"\n" + commas.partition(b"\n")[2], rig=RIG.data())
    assert "use points" in (caught.value.hint or "")
    tabs = csv_of_places(list(NAMES), PLACES, separator="\t").partition(b"\n")
    with pytest.raises(InputError, match="is not a number") as caught:
        _read(tabs[0] + b"\n" + tabs[2].replace(b".", b","), rig=RIG.data())
    assert "use points" in (caught.value.hint or "")
    assert decimal_commas_hint("-1,5e-3") and not decimal_commas_hint("1,2,3") and not decimal_commas_hint("x,5")


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("Hips.x", Column("Hips", "x")), ("Hips_Y", Column("Hips", "y")), ("Hips (z)", Column("Hips", "z")),
        ("Hips x [mm]", Column("Hips", "x")), ("Hips(x)(m)", Column("Hips", "x")), ("Hipsz", Column("Hips", "z")),
        ("Hips.pos.x", Column("Hips", "x")), ("Left_Leg_rot_x", Column("Left_Leg", "x", "angles")),
        ("Hips.qw", Column("Hips", "w", "quaternions")), ("Hips.q.w", Column("Hips", "w", "quaternions")),
        ("Hips.w", None), ("Hips", None), ("x", None), ("", None),
        ("Hips.qx", Column("Hips", "x", "quaternions")), ("(m)", None), ("._x", None),
    ],
)  # fmt: skip
def test_names_of_columns(name: str, column: Column | None) -> None:
    assert column_named(name) == column


def test_names_of_joints_match_in_any_spelling() -> None:
    assert {sided_name(name) for name in ("LHip", "L_Hip", "left hip", "hip.l", "LeftHip", "HipLeft")} == {"left hip"}
    assert matched(["mixamorig:Hips", "left_arm", "R_Arm"], ["Hips", "LeftArm", "RightArm"]) == [0, 1, 2]
    assert matched(["body_hips", "body_left_arm", "body_x"], ["Hips", "LeftArm"]) == [0, 1, -1]
    assert matched(["a_b", "ab"], ["AB", "A.B"]) == [-1, -1], "a name that fits two joints fits none"
    assert [end_of(name) for name in ("Foot_End", "Head End Site", "LeftToe.Nub", "Bend", "_End")] == [
        "Foot", "Head", "LeftToe", "", "",
    ]  # fmt: skip


def test_text_in_arrays_that_is_no_text_is_refused() -> None:
    names = np.array([[0x11FFFF], [65]], np.uint32).view("<U1").ravel()
    for array in (names, names.astype(">U1")[:0], np.frombuffer(names.tobytes(), "<U2")):
        data = npz(positions=PLACES[:, :2], names=array)
        with pytest.raises(InputError, match="text that is damaged" if array.size else "no joint names and parents"):
            _read(data)
