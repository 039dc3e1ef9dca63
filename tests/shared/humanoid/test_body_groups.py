"""Body groups on rigs of every house, by name and without any names."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.body_groups import find_body_parts
from stages.shared.humanoid.joint_names import sense_of
from tests.shared.formats.bvh_texts import HUMANOID, BvhText

# A whole rig in one line: joint(children), lengths by depth do not matter here.
MIXAMO = """Hips(Spine(Spine1(Spine2(Neck(Head(HeadTop_End,LeftEye,RightEye)),LeftShoulder(LeftArm(LeftForeArm(
LeftHand(LeftHandThumb1(LeftHandThumb2),LeftHandIndex1(LeftHandIndex2),LeftHandMiddle1(LeftHandMiddle2)))
)),RightShoulder(RightArm(RightForeArm(RightHand(RightHandThumb1(RightHandThumb2),RightHandIndex1(
RightHandIndex2),RightHandMiddle1(RightHandMiddle2)))))))),LeftUpLeg(LeftLeg(LeftFoot(LeftToeBase(
LeftToe_End)))),RightUpLeg(RightLeg(RightFoot(RightToeBase(RightToe_End)))))"""
CMU = """root(lhipjoint(lfemur(ltibia(lfoot(ltoes)))),rhipjoint(rfemur(rtibia(rfoot(rtoes)))),lowerback(upperback(
thorax(lowerneck(upperneck(head)),lclavicle(lhumerus(lradius(lwrist(lhand(lfingers),lthumb)))),rclavicle(
rhumerus(rradius(rwrist(rhand(rfingers),rthumb))))))))"""
SMPL = """Pelvis(L_Hip(L_Knee(L_Ankle(L_Foot))),R_Hip(R_Knee(R_Ankle(R_Foot))),Spine1(Spine2(Spine3(Neck(Head),
L_Collar(L_Shoulder(L_Elbow(L_Wrist(L_Hand)))),R_Collar(R_Shoulder(R_Elbow(R_Wrist(R_Hand))))))))"""
BIPED = """Bip01(Bip01 Pelvis(Bip01 Spine(Bip01 Spine1(Bip01 Neck(Bip01 Head,Bip01 L Clavicle(Bip01 L UpperArm(
Bip01 L Forearm(Bip01 L Hand(Bip01 L Finger0)))),Bip01 R Clavicle(Bip01 R UpperArm(Bip01 R Forearm(
Bip01 R Hand(Bip01 R Finger0)))))),Bip01 L Thigh(Bip01 L Calf(Bip01 L Foot(Bip01 L Toe0(Bip01 L Toe0Nub))
)),Bip01 R Thigh(Bip01 R Calf(Bip01 R Foot(Bip01 R Toe0(Bip01 R Toe0Nub)))))))"""
UNREAL = """root(pelvis(spine_01(spine_02(clavicle_l(upperarm_l(upperarm_twist_01_l,lowerarm_l(lowerarm_twist_01_l,
hand_l(index_01_l)))),clavicle_r(upperarm_r(upperarm_twist_01_r,lowerarm_r(lowerarm_twist_01_r,hand_r(
index_01_r)))),neck_01(head))),thigh_l(thigh_twist_01_l,calf_l(foot_l(ball_l))),thigh_r(thigh_twist_01_r,
calf_r(foot_r(ball_r)))),ik_foot_root(ik_foot_l,ik_foot_r))"""


def _parse(rig: str) -> tuple[tuple[str, ...], np.ndarray]:
    names: list[str] = []
    parents: list[int] = []
    stack: list[int] = []
    word = ""
    for letter in rig.replace("\n", "") + ",":
        if letter not in "(),":
            word += letter
            continue
        if word:
            names.append(word.strip())
            parents.append(stack[-1] if stack else -1)
        if letter == "(":
            stack.append(len(names) - 1)
        elif letter == ")":
            stack.pop()
        word = ""
    return tuple(names), np.array(parents, np.int32)


def _lengths(names: tuple[str, ...]) -> np.ndarray:
    """Offsets long for limbs' bones, short for the rest, as bodies have them."""
    long = {"leg": 40.0, "arm": 25.0, "trunk": 15.0, "neck": 10.0, "head": 10.0}
    return np.array([[0.0, long.get(sense_of(name).part, 3.0), 0.0] for name in names])


@pytest.mark.parametrize(
    ("rig", "pelvis", "left_arm", "right_leg", "spine", "above"),
    [
        (MIXAMO, "Hips", "LeftShoulder", "RightUpLeg", "Head", ()),
        (CMU, "root", "lclavicle", "rhipjoint", "head", ()),
        (SMPL, "Pelvis", "L_Collar", "R_Hip", "Head", ()),
        (BIPED, "Bip01 Pelvis", "Bip01 L Clavicle", "Bip01 R Thigh", "Bip01 Head", ("Bip01",)),
        (UNREAL, "pelvis", "clavicle_l", "thigh_r", "head", ("root", "ik_foot_root", "ik_foot_l")),
    ],
    ids=["mixamo", "cmu", "smpl", "biped", "unreal"],
)
def test_known_rigs(rig: str, pelvis: str, left_arm: str, right_leg: str, spine: str, above: tuple[str, ...]) -> None:
    names, parents = _parse(rig)
    offsets = _lengths(names)
    if "Bip01 Spine" in names:
        offsets[names.index("Bip01 Spine")] *= 0.1
    parts = find_body_parts(names, parents, offsets, np.zeros(len(names)))
    group = dict(zip(names, parts.groups, strict=True))
    assert names[parts.pelvis] == pelvis and parts.sided
    assert group[left_arm] == 1 and group[right_leg] == 4 and group[spine] == 0 and group[pelvis] == 0
    assert names[parts.chains[1][0]] == left_arm and names[parts.chains[0][-1]].lower().endswith("head")
    assert all(group[name] == -1 for name in above)
    on_chains = {names[joint] for chain in parts.chains for joint in chain}
    assert not [
        name for name in on_chains if any(word in name.lower() for word in ("thumb", "index", "eye", "twist"))
    ]


def _nameless(text: BvhText) -> BvhText:
    text.names = {name: f"bone{index:02d}" for index, (name, _, _) in enumerate(HUMANOID)}
    return text


@pytest.mark.parametrize("z_up", [False, True])
def test_a_rig_without_names_is_told_by_its_shape(z_up: bool) -> None:
    named = motion_of(read_bvh(BvhText(z_up=z_up).data(), "a"))[0]
    skeleton, _, notes = motion_of(read_bvh(_nameless(BvhText(z_up=z_up)).data(), "a"))
    assert skeleton.groups.tolist() == named.groups.tolist()
    assert skeleton.root == named.root and skeleton.sampled.tolist() == named.sampled.tolist()
    assert "no sides" in notes[0]


def test_sides_come_from_the_pose_where_names_are_silent() -> None:
    text = _nameless(BvhText())
    mirrored = text.data().decode()
    # Turn the feet round: what was the left side of a figure that looks forward is now the right one.
    mirrored = mirrored.replace("OFFSET 0.000000 -6.000000 13.000000", "OFFSET 0.000000 -6.000000 -13.000000")
    mirrored = mirrored.replace("OFFSET 0.000000 -42.000000 1.000000", "OFFSET 0.000000 -42.000000 -6.000000")
    groups = motion_of(read_bvh(mirrored.encode(), "a"))[0].groups
    assert groups[5] == 2 and groups[9] == 1 and groups[13] == 4


def test_animals_and_trees_are_no_humanoids() -> None:
    names, parents = _parse("a(b(c(d(e))),f)")
    with pytest.raises(InputError, match="two legs and two arms"):
        find_body_parts(names, parents, np.ones((6, 3)), np.zeros(6))


@pytest.mark.parametrize(
    ("name", "side", "part"),
    [
        ("mixamorig:LeftHandIndex1", "left", "finger"), ("lShldr", "left", "arm"), ("rButtock", "right", "leg"),
        ("rhipjoint", "right", "leg"), ("leftupleg", "left", "leg"), ("lowerarm_r", "right", "arm"),
        ("left_hip_pitch", "left", "leg"), ("waist_yaw", "", "trunk"), ("Hips", "", "hip"),
        ("rradius", "right", "arm"),
        ("radius", "", "arm"), ("HeadTop_End", "", "end"), ("LeftToe_End", "left", "end"), ("joint_Root", "", ""),
        ("Armature", "", ""), ("leg", "", "leg"), ("lowerback", "", "trunk"),
        ("CC_Base_L_ThighTwist01", "left", "helper"),
    ],
)  # fmt: skip
def test_names(name: str, side: str, part: str) -> None:
    assert sense_of(name)[:2] == (side, part)
