"""Robots' joint angles: joints where plain matrices put them, every layout, and clear words for what is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.errors import InputError
from data_schemas.notes import Flag
from data_schemas.skeleton import BODY_GROUPS
from stages.shared.formats.readers import recognise
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.robot_csv import read_robot_csv
from stages.shared.formats.robot_table import ROOT_COLUMNS
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.robot_files import ANGLES, JOINTS, RobotText, csv_of, some_rows

ROBOT = RobotText()


def _read(data: bytes, robot: RobotText = ROBOT, **options: object) -> Recording:
    asked = Asked(rig=robot.urdf(), rig_name="t.urdf", **options)  # type: ignore[arg-type]
    (recording,) = read_robot_csv(data, "t.csv", asked)
    return recording


def _agrees(recording: Recording, robot: RobotText, rows: np.ndarray) -> None:
    places = positions_of(recording.skeleton, recording.motion)
    wanted = robot.places(rows)
    names = {name.removesuffix("_joint"): place for name, place in wanted.items()}
    for joint, name in enumerate(recording.skeleton.names):
        assert np.allclose(places[:, joint], names[name][:, [1, 2, 0]], atol=2e-6), name


@pytest.mark.parametrize(
    "robot",
    [
        ROBOT,
        RobotText(mimics={"right_wrist_joint": ("left_wrist_joint", -0.5, 0.2)}),
        RobotText(joints=(("float", "floating", "world", "pelvis", (0, 0, 0), (0, 0, 0), (1, 0, 0)), *JOINTS)),
    ],
    ids=["plain", "mimic", "floating-base"],
)
def test_joints_are_where_plain_matrices_put_them(robot: RobotText) -> None:
    angles = sum(name in robot.angle_names for name in ANGLES)
    rows = np.round(some_rows(20, angles), 6)
    recording = _read(csv_of(rows), robot)
    if robot.joints is JOINTS:
        _agrees(recording, robot, rows)
    assert recording.skeleton.names[0] == "pelvis" and recording.skeleton.joints == 1 + len(ANGLES) + 1


def test_the_body_is_found_with_feet_hands_and_head() -> None:
    skeleton = _read(csv_of(some_rows())).skeleton
    groups = {name: BODY_GROUPS[group] for name, group in zip(skeleton.names, skeleton.groups, strict=True)}
    assert groups["left_ankle"] == "left_leg" and groups["right_elbow"] == "right_arm" and groups["head"] == "spine"
    tails = dict(zip(skeleton.names, skeleton.tails, strict=True))
    assert np.allclose(tails["left_ankle"], [0, -0.04, 0.13])  # the box's lower front edge, from its solids
    assert np.allclose(tails["left_wrist"], [0, 0, 0.07])  # the fixed palm
    assert np.linalg.norm(tails["right_wrist"]) == pytest.approx(0.1)  # the last bone's direction
    assert skeleton.up_axis == "y" and skeleton.unit_m == 1 and skeleton.names[skeleton.root] == "pelvis"


def test_a_first_line_of_names_gives_the_order() -> None:
    rows = np.round(some_rows(), 6)
    names = [*ROOT_COLUMNS, *ANGLES]
    order = np.random.default_rng(0).permutation(len(names))
    plain = _read(csv_of(rows))
    named = _read(csv_of(rows[:, order], ",".join(names[i] for i in order)))
    assert np.array_equal(plain.motion.rotations, named.motion.rotations)
    spelled = ["frame", "base_pos_x", "base_pos_y", "base_pos_z", "quat_x", "quat_y", "quat_z", "quat_w"]
    spelled += [name.removesuffix("_joint") for name in ANGLES]
    counted = np.hstack([np.arange(len(rows))[:, None], rows])
    assert np.array_equal(
        plain.motion.rotations, _read(csv_of(counted, ";".join(spelled), "\r\n", ";")).motion.rotations
    )


@pytest.mark.parametrize("header", ["", "root_x,root_y,root_z,root_qx,root_qy,root_qz,root_qw,a_joint"])
def test_the_format_is_recognised_by_content(header: str) -> None:
    found = recognise(csv_of(some_rows(), header), "any.csv")
    assert found is not None and found.name == "robot"
    for other in (b"Hips.x,Hips.y,Hips.z\n1,2,3\n", b"root_x,root_y,root_z,head_x,head_y,head_z\n"):
        found = recognise(other, "any.csv")
        assert found is not None and found.name == "positions"
    assert recognise(b"name,age\nBo,3\n", "any.csv") is None and recognise(b"1,2,3\n", "any.csv") is None


def test_the_rate_comes_from_the_user_or_is_assumed() -> None:
    assert _read(csv_of(some_rows()), fps_override=60.0).motion.fps == 60
    usual = _read(csv_of(some_rows()))
    assert usual.motion.fps == 30 and "30" in str(usual.remarks[0]) and usual.notes == []


def test_quaternions_with_w_first_are_suspected() -> None:
    rows = some_rows()
    rows[:, 3:7] = np.tile([np.cos(0.1), 0, 0, np.sin(0.1)], (len(rows), 1))
    assert [each.flag for each in _read(csv_of(rows)).notes] == [Flag.UPSIDE_DOWN]


def _with(row: int, column: int, value: float) -> bytes:
    rows = some_rows()
    rows[row, column] = value
    return csv_of(rows)


WRONG = {
    "columns": (csv_of(some_rows()[:, :-1]), "has 21 columns, expected 22"),
    "nan": (_with(4, 9, np.nan), "line 5: left_knee_joint is not a finite number"),
    "inf": (_with(0, 0, np.inf), "line 1: root_x is not a finite number"),
    "far": (_with(2, 1, 1e9), "line 3: root_y is 1e+09"),
    "quaternion": (_with(3, 6, 1.9), "line 4: the root's quaternion"),
    "word": (csv_of(some_rows()).replace(b"\n", b"\nhello,", 1), "line 2: 23 cells where there are 22"),
    "no-number": (csv_of(some_rows()).replace(b"0.75", b"0.7x", 1), "is not a number"),
    "truncated": (csv_of(some_rows())[:-60], "Is the file truncated?"),
    "empty": (b"\n\n", "has no rows"),
    "binary": (b"\0\1\2" * 9, "is not plain text"),
    "header-only": (csv_of(some_rows(0), ",".join([*ROOT_COLUMNS, *ANGLES])), "has no rows"),
    "strange-name": (
        csv_of(some_rows(), ",".join([*ROOT_COLUMNS, *ANGLES[:-1], "tail"])),
        "'tail' is neither a joint",
    ),
    "twice": (csv_of(some_rows(), ",".join([*ROOT_COLUMNS, *ANGLES[:-1], ANGLES[0]])), "stands twice"),
    "missing": (csv_of(some_rows()[:, :-2], ",".join([*ROOT_COLUMNS, *ANGLES[:-2]])), "no column for"),
}


@pytest.mark.parametrize(("data", "words"), WRONG.values(), ids=WRONG)
def test_faults_are_reported(data: bytes, words: str) -> None:
    with pytest.raises(InputError) as caught:
        _read(data)
    assert words in f"{caught.value.message} {caught.value.hint}" and "t.csv" in caught.value.message


def test_without_a_urdf_it_says_how_to_give_one() -> None:
    for rig, name in ((b"", ""), (b"HIERARCHY", "x.bvh")):
        with pytest.raises(InputError) as caught:
            read_robot_csv(csv_of(some_rows()), "t.csv", Asked(rig=rig, rig_name=name))
        assert "--skeleton" in (caught.value.hint or "")
