"""URDF files: what is refused before it can cost anything, and what a robot's tree may not be."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.robot_rig import robot_rig
from stages.shared.formats.urdf import read_urdf
from tests.shared.formats.robot_files import ANGLES, JOINTS, RobotText

_BOMB = (
    "<?xml version='1.0'?>\n<!DOCTYPE r [<!ENTITY a 'ha'>"
    + "".join(f"<!ENTITY {b} '{f'&{a};' * 10}'>" for a, b in zip("abcdefghi", "bcdefghij", strict=True))
    + "]>\n"
)
_SECRET = "<!DOCTYPE r [<!ENTITY secret SYSTEM 'file:///etc/passwd'>]>\n"


def _joint(name: str, parent: str, child: str, kind: str = "revolute", axis: tuple = (1, 0, 0)) -> tuple:
    return (name, kind, parent, child, (0, 0, 0.1), (0, 0, 0), axis)


WRONG = {
    "entity-bomb": (RobotText(before=_BOMB, name="&j;").urdf(), "declares a document type"),
    "entity-bomb-utf-16": (RobotText(before=_BOMB[22:]).urdf().decode().encode("utf-16"), "declares a document type"),
    "outside-entity": (RobotText(before=_SECRET, name="&secret;").urdf(), "declares a document type"),
    "unknown-entity": (RobotText(name="&none;").urdf(), "undefined entity"),
    "no-xml": (b"{}", "not well-formed"),
    "empty": (b"", "no element found"),
    "truncated": (RobotText().urdf()[:-30], "line"),
    "other-xml": (b"<html><robot/></html>", "no URDF"),
    "xacro": (RobotText(more="<xacro:macro name='leg'/>").urdf(), "xacro"),
    "deep": (b"<robot>" + b"<a>" * 5000, "nested deeper"),
    "flood": (b"<robot>" + b"<a/>" * 300_000 + b"</robot>", "more than those of any robot"),
    "strange-encoding": (RobotText(before="<?xml version='1.0' encoding='klingon'?>").urdf(), "encoding"),
    "no-joints": (b"<robot><link name='a'/></robot>", "0 joints"),
    "ring": (RobotText(joints=(_joint("a", "pelvis", "x"), _joint("b", "x", "pelvis"))).urdf(), "ring"),
    "ring-aside": (RobotText(joints=(*JOINTS, _joint("a", "x", "y"), _joint("b", "y", "x"))).urdf(), "ring"),
    "self": (RobotText(joints=(*JOINTS, _joint("a", "x", "x"))).urdf(), "ring"),
    "two-parents": (RobotText(joints=(*JOINTS, _joint("a", "pelvis", "waist_link"))).urdf(), "hangs on two joints"),
    "two-roots": (
        RobotText(joints=(*JOINTS, _joint("a", "x", "y"))).urdf(),
        "hang on nothing",
    ),
    "joint-twice": (RobotText(joints=(*JOINTS, _joint(ANGLES[0], "pelvis", "x"))).urdf(), "stands twice"),
    "link-twice": (RobotText(more="<link name='pelvis'/>").urdf(), "stands twice"),
    "no-such-link": (RobotText().urdf().replace(b"<link name='pelvis'></link>", b""), "which is not there"),
    "slides": (RobotText(joints=(*JOINTS, _joint("a", "pelvis", "x", "prismatic"))).urdf(), "slides"),
    "kind": (RobotText(joints=(*JOINTS, _joint("a", "pelvis", "x", "hinge"))).urdf(), "type 'hinge'"),
    "no-axis": (RobotText(joints=(*JOINTS, _joint("a", "pelvis", "x", axis=(0, 0, 0)))).urdf(), "axis of no length"),
    "nan": (RobotText(joints=(*JOINTS, _joint("a", "pelvis", "x", axis=("nan", 0, 1)))).urdf(), "three numbers"),
    "far": (RobotText(joints=(*JOINTS, _joint("a", "pelvis", "x", axis=(1e9, 0, 1)))).urdf(), "three numbers"),
    "two-numbers": (RobotText(joints=(*JOINTS, _joint("a", "pelvis", "x", axis=(0, 1)))).urdf(), "three numbers"),
    "limits": (RobotText(limits=(1, -1)).urdf(), "lower limit 1 lies above"),
    "mimic": (RobotText(mimics={ANGLES[0]: ("gone", 1, 0)}).urdf(), "mimics 'gone'"),
    "mimic-ring": (RobotText(mimics={ANGLES[0]: (ANGLES[1], 1, 0), ANGLES[1]: (ANGLES[0], 1, 0)}).urdf(), "mimics"),
}


@pytest.mark.parametrize(("data", "words"), WRONG.values(), ids=WRONG)
def test_faults_are_reported_before_more_is_read(data: bytes, words: str) -> None:
    begun = time.process_time()
    with pytest.raises(InputError) as caught:
        read_urdf(data, "t.urdf")
    assert words in caught.value.message and "t.urdf" in caught.value.message
    assert time.process_time() - begun < 1


def test_a_floating_joint_below_the_root_is_refused() -> None:
    with pytest.raises(InputError, match="floats"):
        robot_rig(RobotText(joints=(*JOINTS, _joint("a", "pelvis", "ball", "floating"))).urdf(), "t.urdf")
    with pytest.raises(InputError, match="none of its joints turns"):
        robot_rig(RobotText(joints=(_joint("a", "pelvis", "x", "fixed"),)).urdf(), "t.urdf")


def test_limits_and_order_are_the_files() -> None:
    rig = robot_rig(RobotText(limits=(-1.5, 2.25)).urdf(), "t.urdf")
    assert rig.angle_names == ANGLES
    wrists = [name.endswith("wrist_joint") for name in ANGLES]
    assert np.array_equal(rig.hinges.limits[~np.array(wrists)], np.tile([-1.5, 2.25], (len(ANGLES) - 2, 1)))
    assert np.array_equal(rig.hinges.limits[wrists], np.tile([-math.inf, math.inf], (2, 1)))  # continuous


def test_no_mesh_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a file was opened")

    data = RobotText().urdf()
    assert b"file:///dev/zero" in data
    monkeypatch.setattr("builtins.open", refuse)
    monkeypatch.setattr(Path, "open", refuse)
    robot_rig.__wrapped__(data, "t.urdf")


HEADS = {  # in a figure's axes
    "fixed-link": (RobotText(), (0.0, 0.04 + 0.35 * math.cos(0.1), 0.35 * math.sin(0.1) - 0.004)),
    "none-at-all": (RobotText(joints=tuple(joint for joint in JOINTS if joint[0] != "head_joint")), (0, 0.4325, 0)),
    "known": (RobotText(name="g1_29dof_rev_1_0"), (0.0, 0.38, 0.0)),
}


@pytest.mark.parametrize(("robot", "place"), HEADS.values(), ids=HEADS)
def test_a_head_that_turns_nowhere_is_a_still_joint(robot: RobotText, place: tuple) -> None:
    rig = robot_rig(robot.urdf(), "t.urdf")
    head = rig.names.index("head")
    assert rig.hinges.columns[head] == -1 and rig.names[rig.hinges.parents[head]] == "waist_yaw"
    assert np.allclose(rig.hinges.offsets[head], place, atol=1e-4)
    assert all(parent < joint for joint, parent in enumerate(rig.hinges.parents))
