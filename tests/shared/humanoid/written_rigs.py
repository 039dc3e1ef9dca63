"""Rigs as the usual tools name and build them, written down here with plausible sizes, and moved by a real clip.

A rig is one line: joint@place(children). A joint whose name holds "%" while its parent's does not stands for two,
with the rig's words for left and right; places are those of the left side. "!" before a name: no part of the body.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import NO_GROUP
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_rows import local_quaternions
from stages.shared.formats.source_body import SourcePoses, SourceRig

# Metres, a man of 1.75 m who faces +Z with his arms out.
PLACES = {
    "ground": (0, 0, 0), "pelvis": (0, 0.95, 0), "hip": (0.09, 0.9, 0), "groin": (0.05, 0.93, 0.01),
    "knee": (0.1, 0.49, 0.01), "calf": (0.1, 0.3, 0), "ankle": (0.1, 0.09, -0.02), "toe": (0.11, 0.02, 0.1),
    "toetip": (0.11, 0.01, 0.18), "thigh": (0.1, 0.7, 0), "spine1": (0, 1.05, -0.01), "spine2": (0, 1.15, -0.02),
    "spine3": (0, 1.26, -0.03), "chest": (0, 1.35, -0.03), "collar": (0.03, 1.44, -0.01),
    "shoulder": (0.17, 1.43, -0.03), "upperarm": (0.3, 1.43, -0.03), "elbow": (0.44, 1.43, -0.04),
    "forearm": (0.56, 1.43, -0.03), "wrist": (0.69, 1.43, -0.03), "palm": (0.76, 1.43, -0.02),
    "handtip": (0.86, 1.42, -0.02), "neck": (0, 1.49, -0.03), "neck2": (0, 1.54, -0.02), "head": (0, 1.6, -0.01),
    "headtip": (0, 1.76, 0.01), "eye": (0.03, 1.66, 0.07), "jaw": (0, 1.6, 0.02), "bust": (0.08, 1.32, 0.1),
    "hair": (0, 1.74, -0.09), "hairtip": (0, 1.5, -0.15), "skirt": (0.12, 0.9, 0.08), "skirttip": (0.16, 0.6, 0.12),
}  # fmt: skip
for _finger, (_start, _step) in enumerate(
    [((0.71, 1.41, 0.02), (0.025, -0.01, 0.025)), ((0.78, 1.43, 0.01), (0.035, 0, 0.004)),
     ((0.78, 1.43, -0.015), (0.04, 0, 0)), ((0.775, 1.43, -0.035), (0.036, 0, -0.004)),
     ((0.765, 1.42, -0.055), (0.028, 0, -0.008))]
):  # fmt: skip
    for _bone in range(4):
        PLACES[f"finger{_finger}{_bone}"] = tuple(np.add(_start, np.multiply(_bone, _step)))  # type: ignore[assignment]


def _fingers(names: list[str], bones: int = 3) -> str:
    out = []
    for finger, name in enumerate(names):
        joints = [f"{name.format(bone + 1)}@finger{finger}{bone}" for bone in range(bones)]
        out.append("(".join(joints) + ")" * (bones - 1))
    return ",".join(out)


_MIXAMO_FINGERS = _fingers([f"%Hand{finger}{{0}}" for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky")], 4)
_UNREAL_FINGERS = _fingers([f"{finger}_0{{0}}_%" for finger in ("thumb", "index", "middle", "ring", "pinky")])
_VRM_FINGERS = _fingers([f"J_Bip_%_{finger}{{0}}" for finger in ("Thumb", "Index", "Middle", "Ring", "Little")])
_BIPED_FINGERS = _fingers([f"Bip01 % Finger{finger}{{0}}" for finger in range(5)])
_SMPLX_FINGERS = _fingers([f"%_{finger}{{0}}" for finger in ("thumb", "index", "middle", "ring", "pinky")])
_MMD_FINGERS = _fingers([f"%{finger}{{0}}" for finger in ("親指", "人指", "中指", "薬指", "小指")])

WRITTEN: dict[str, tuple[str, tuple[str, str]]] = {
    "lafan1": (
        "Hips@pelvis(%UpLeg@hip(%Leg@knee(%Foot@ankle(%Toe@toe))),Spine@spine1(Spine1@spine2(Spine2@spine3("
        "Neck@neck(Head@head),%Shoulder@collar(%Arm@shoulder(%ForeArm@elbow(%Hand@wrist)))))))",
        ("Left", "Right"),
    ),
    "mixamo": (
        "mixamorig:Hips@pelvis(mixamorig:Spine@spine1(mixamorig:Spine1@spine2(mixamorig:Spine2@chest(mixamorig:Neck@"
        "neck(mixamorig:Head@head(mixamorig:HeadTop_End@headtip,mixamorig:%Eye@eye)),%Shoulder@collar(%Arm@shoulder("
        f"%ForeArm@elbow(%Hand@wrist({_MIXAMO_FINGERS}))))))),%UpLeg@hip(%Leg@knee(%Foot@ankle(%ToeBase@toe("
        "%Toe_End@toetip)))))",
        ("mixamorig:Left", "mixamorig:Right"),
    ),
    "smpl": (
        "Pelvis@pelvis(%_Hip@hip(%_Knee@knee(%_Ankle@ankle(%_Foot@toe))),Spine1@spine1(Spine2@spine2(Spine3@spine3("
        "Neck@neck(Head@head),%_Collar@collar(%_Shoulder@shoulder(%_Elbow@elbow(%_Wrist@wrist(%_Hand@palm))))))))",
        ("L", "R"),
    ),
    "smplx": (
        "pelvis@pelvis(%_hip@hip(%_knee@knee(%_ankle@ankle(%_foot@toe))),spine1@spine1(spine2@spine2(spine3@spine3("
        "neck@neck(head@head(jaw@jaw,%_eye_smplhf@eye)),%_collar@collar(%_shoulder@shoulder(%_elbow@elbow(%_wrist@"
        f"wrist({_SMPLX_FINGERS}))))))))",
        ("left", "right"),
    ),
    "unreal": (
        "!root@ground(pelvis@pelvis(spine_01@spine1(spine_02@spine2(spine_03@chest(clavicle_%@collar(upperarm_%@"
        f"shoulder(upperarm_twist_01_%@upperarm,lowerarm_%@elbow(lowerarm_twist_01_%@forearm,hand_%@wrist("
        f"{_UNREAL_FINGERS})))),neck_01@neck(head@head)))),thigh_%@hip(thigh_twist_01_%@thigh,calf_%@knee("
        "calf_twist_01_%@calf,foot_%@ankle(ball_%@toe)))),!ik_foot_root@ground(!ik_foot_%@ankle),!ik_hand_root@ground("
        "!ik_hand_gun@wrist(!ik_hand_%@wrist)))",
        ("l", "r"),
    ),
    "vrm": (
        "!Root@ground(J_Bip_C_Hips@pelvis(J_Bip_C_Spine@spine1(J_Bip_C_Chest@spine2(J_Bip_C_UpperChest@chest("
        "J_Sec_%_Bust1@bust,J_Bip_C_Neck@neck(J_Bip_C_Head@head(J_Adj_%_FaceEye@eye,J_Sec_Hair1_01@hair("
        "J_Sec_Hair2_01@hairtip))),J_Bip_%_Shoulder@collar(J_Bip_%_UpperArm@shoulder(J_Bip_%_LowerArm@elbow("
        f"J_Bip_%_Hand@wrist({_VRM_FINGERS}))))))),J_Bip_%_UpperLeg@hip(J_Bip_%_LowerLeg@knee(J_Bip_%_Foot@ankle("
        "J_Bip_%_ToeBase@toe)))))",
        ("L", "R"),
    ),
    "biped": (
        "!Bip01@pelvis(Bip01 Pelvis@pelvis(Bip01 Spine@spine1(Bip01 Spine1@spine2(Bip01 Spine2@chest(Bip01 Neck@neck("
        "Bip01 Head@head(Bip01 HeadNub@headtip),Bip01 % Clavicle@collar(Bip01 % UpperArm@shoulder(Bip01 % Forearm@"
        f"elbow(Bip01 % Hand@wrist({_BIPED_FINGERS}))))))),Bip01 % Thigh@hip(Bip01 % Calf@knee(Bip01 % Foot@ankle("
        "Bip01 % Toe0@toe(Bip01 % Toe0Nub@toetip))))))",
        ("L", "R"),
    ),
    "xsens": (
        "Hips@pelvis(Chest@spine1(Chest2@spine2(Chest3@spine3(Chest4@chest(Neck@neck(Head@head),%Collar@collar("
        "%Shoulder@shoulder(%Elbow@elbow(%Wrist@wrist))))))),%Hip@hip(%Knee@knee(%Ankle@ankle(%Toe@toe))))",
        ("Left", "Right"),
    ),
    "xsens-mvn": (
        "Pelvis@pelvis(L5@spine1(L3@spine2(T12@spine3(T8@chest(Neck@neck(Head@head),%Shoulder@collar(%UpperArm@"
        "shoulder(%ForeArm@elbow(%Hand@wrist))))))),%UpperLeg@hip(%LowerLeg@knee(%Foot@ankle(%Toe@toe))))",
        ("Left", "Right"),
    ),
    "rokoko": (
        "Hips@pelvis(Spine@spine1(Spine1@spine2(Spine2@spine3(Spine3@chest(Neck@neck(Head@head),%Shoulder@collar(%Arm@"
        "shoulder(%ForeArm@elbow(%Hand@wrist))))))),%Thigh@hip(%Shin@knee(%Foot@ankle(%Toe@toe(%ToeTip@toetip)))))",
        ("Left", "Right"),
    ),
    "vicon": (
        "root@pelvis(%hipjoint@groin(%femur@hip(%tibia@knee(%foot@ankle(%toes@toe)))),lowerback@spine1(upperback@spine2("
        "thorax@chest(lowerneck@neck(upperneck@neck2(head@head)),%clavicle@collar(%humerus@shoulder(%radius@elbow("
        "%wrist@forearm(%hand@wrist(%fingers@palm),%thumb@finger00)))))))",
        ("l", "r"),
    ),
    "mmd": (
        "!全ての親@ground(!センター@ground(下半身@pelvis(%足@hip(%ひざ@knee(%足首@ankle(%つま先@toe))),上半身@spine1("
        "上半身2@chest(首@neck(頭@head(%目@eye)),%肩@collar(%腕@shoulder(%ひじ@elbow(%手捩@forearm(%手首@wrist("
        f"{_MMD_FINGERS})))))))))),!%足ＩＫ@ankle(!%つま先ＩＫ@toe))",
        ("左", "右"),
    ),
    "mmd-centre": (
        "!全ての親@ground(センター@pelvis(下半身@spine1(%足@hip(%ひざ@knee(%足首@ankle(%つま先@toe)))),上半身@spine1("
        "上半身2@chest(首@neck(頭@head(%目@eye)),%肩@collar(%腕@shoulder(%ひじ@elbow(%手首@wrist)))))))",
        ("左", "右"),
    ),
    "german": (
        "Becken@pelvis(Wirbelsäule@spine1(Brustkorb@chest(Hals@neck(Kopf@head),Schlüsselbein_%@collar(Oberarm_%@shoulder("
        "Unterarm_%@elbow(Hand_%@wrist))))),Oberschenkel_%@hip(Unterschenkel_%@knee(Fuß_%@ankle(Zehen_%@toe))))",
        ("links", "rechts"),
    ),
    "daz": (
        "hip@pelvis(pelvis@pelvis(%ThighBend@hip(%ThighTwist@thigh(%Shin@knee(%Foot@ankle(%Metatarsals@ankle(%Toe@toe"
        ")))))),abdomenLower@spine1(abdomenUpper@spine2(chestLower@spine3(chestUpper@chest(%Collar@collar(%ShldrBend@"
        "shoulder(%ShldrTwist@upperarm(%ForearmBend@elbow(%ForearmTwist@forearm(%Hand@wrist))))),neckLower@neck("
        "neckUpper@neck2(head@head))))))",
        ("l", "r"),
    ),
}


@dataclass(frozen=True)
class WrittenRig:
    """A rig in metres, the groups that its parts must have, and a motion of it."""

    rig: SourceRig
    groups: np.ndarray
    poses: SourcePoses


def written_rig(name: str, clip: str = "walk") -> WrittenRig:
    """One of WRITTEN, moved as the embedded clip of that name moves."""
    text, sides = WRITTEN[name]
    names, parents, places, marks, groups = [], [], [], [], []
    for joint, parent, side, place, outside in _expanded(_tree(text), sides):
        names.append(joint)
        parents.append(parent)
        marks.append(place)
        x, y, z = PLACES[place]
        places.append((-x if side == 1 else x, y, z))
        groups.append(_group(place, side, outside, groups[parent] if parent >= 0 else NO_GROUP))
    at = np.array(places, float)
    offsets = np.array([at[j] - at[p] if p >= 0 else (0.0, 0.0, 0.0) for j, p in enumerate(parents)])
    tips = np.array([_tip(mark, at[j]) if j not in parents else (0, 0, 0) for j, mark in enumerate(marks)], float)
    rig = SourceRig(
        tuple(names), tuple(parents), tuple(map(tuple, offsets.tolist())), tuple(map(tuple, tips.tolist())),
        tuple(j == 0 for j in range(len(names))),
    )  # fmt: skip
    return WrittenRig(rig, np.array(groups, np.int8), _moved(rig, marks, at, clip))


def _tree(text: str) -> list[tuple[int, str]]:
    """(depth, "name@place") in order."""
    out, depth = [], 0
    for token in re.findall(r"[(),]|[^(),]+", text):
        if token == "(":
            depth += 1
        elif token == ")":
            depth -= 1
        elif token != ",":
            out.append((depth, token))
    return out


def _expanded(tree: list[tuple[int, str]], sides: tuple[str, str]) -> list[tuple[str, int, int, str, bool]]:
    """Joints as (name, parent, side or -1, place, outside), parents before children, both sides of what has two."""
    out: list[tuple[str, int, int, str, bool]] = []

    def grow(first: int, stop: int, parent: int, side: int) -> None:
        at = first
        while at < stop:
            depth, token = tree[at]
            end = next((i for i in range(at + 1, stop) if tree[i][0] <= depth), stop)
            name, place = token.split("@")
            for mine in (0, 1) if "%" in name and side < 0 else (side,):
                word = name.lstrip("!").replace("%", sides[mine]) if mine >= 0 else name.lstrip("!")
                out.append((word, parent, mine, place, name.startswith("!")))
                grow(at + 1, end, len(out) - 1, mine)
            at = end

    grow(0, len(tree), -1, -1)
    return out


def _group(place: str, side: int, outside: bool, above: int) -> int:
    if outside:
        return NO_GROUP
    if above > 0:  # below a limb's first joint
        return above
    if place in ("hip", "groin", "knee"):
        return 3 + side
    return 1 + side if place in ("collar", "shoulder") else 0


def _tip(mark: str, at: np.ndarray) -> tuple[float, float, float]:
    """An End Site for leaves that real files give one to: hands, heads and toes; zeros for the others."""
    ends = {"wrist": "handtip", "head": "headtip", "toe": "toetip"}
    if mark not in ends:
        return (0.0, 0.0, 0.0)
    x, y, z = PLACES[ends[mark]]
    return tuple(np.subtract((np.copysign(x, at[0]) if x else 0.0, y, z), at).tolist())


# --- motion -------------------------------------------------------------------------------------

_CLIPS = Path(__file__).parents[3] / "stages" / "shared" / "clips"
# Which joint of the clips' figure moves what lies at a place.
_MOVERS = {
    "chest": ("spine2", "spine3", "chest"),
    "neck": ("neck", "neck2", "head", "headtip", "eye", "jaw", "hair", "hairtip"),
    "shoulder": ("shoulder", "upperarm"), "elbow": ("elbow", "forearm", "wrist", "palm", "handtip"),
    "hip": ("hip", "thigh"), "knee": ("knee", "calf"), "ankle": ("ankle", "toe", "toetip"),
}  # fmt: skip
_BY_PLACE = {place: mover for mover, places in _MOVERS.items() for place in places}


def _moved(rig: SourceRig, marks: list[str], places: np.ndarray, clip: str) -> SourcePoses:
    """The clip's movement on the rig: every part turns as the clip's same part turns from its zero pose."""
    bvh = read_bvh((_CLIPS / f"{clip}.bvh").read_bytes(), clip)
    local = local_quaternions(bvh.joints, bvh.values)
    turned: dict[str, Rotation] = {}
    for index, joint in enumerate(bvh.joints):
        own = Rotation.from_quat(local[:, index])
        turned[joint.name] = turned[bvh.joints[joint.parent].name] * own if joint.parent >= 0 else own
    look = Rotation.from_euler("y", 90, degrees=True)  # the clips' figure faces +X
    frames = bvh.frames
    world = np.zeros((frames, len(marks), 4))
    for joint, mark in enumerate(marks):
        mover, side = _mover(mark), "right" if places[joint][0] < 0 else "left"
        total = turned.get(mover, turned.get(f"{side}_{mover}", turned["root"])) * look
        if mover in ("shoulder", "elbow"):  # arms that hang are its zero pose
            total = total * Rotation.from_euler("z", 90 if side == "right" else -90, degrees=True)
        world[:, joint] = total.as_quat()
    if marks[0] == "ground":  # a joint on the floor stays there
        for joint, mark in enumerate(marks):
            if mark == "ground":
                world[:, joint] = (0, 0, 0, 1)
    out = world.copy()
    for joint, parent in enumerate(rig.parents):
        if parent >= 0:
            above = Rotation.from_quat(world[:, parent]).inv()
            out[:, joint] = (above * Rotation.from_quat(world[:, joint])).as_quat()
    root = bvh.values[:, :3] / 100 if marks[0] != "ground" else np.zeros((frames, 3))
    pelvis = marks.index("pelvis")
    if rig.parents[pelvis] >= 0 and marks[0] == "ground":
        return SourcePoses(out, root, 30.0, [pelvis], (bvh.values[:, None, :3] / 100))
    return SourcePoses(out, root, 30.0)


def _mover(mark: str) -> str:
    return _BY_PLACE.get(mark, "elbow" if mark.startswith("finger") else "root")


def standing(written: WrittenRig) -> WrittenRig:
    """The same rig in one frame, as it was built, with no motion at all."""
    joints = len(written.rig.names)
    still = np.tile((0.0, 0.0, 0.0, 1.0), (1, joints, 1))
    return replace(written, poses=SourcePoses(still, np.array([[0.0, 0.95, 0.0]]), 30.0))
