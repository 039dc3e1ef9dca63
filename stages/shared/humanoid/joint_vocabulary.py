"""The words of joint names and the part of the body that each means, in English, German and Japanese."""

from __future__ import annotations

# Part, words that must match whole, and longer words that may be part of another ("lefthand", "forearm").
# Tried in this order, since a finger's name often contains the hand's, and a toe's the foot's.
PARTS = tuple(
    (part, frozenset(whole.split()), tuple(inside.split()))
    for part, whole, inside in (
        ("end", "end nub nubs site tip tips headtop toptip", ""),
        (
            "helper",
            "ik fk prop gun tail cape sec interaction",
            "twist helper dummy pole weapon sword attach socket breast skirt corrective centerofmass",
        ),
        (
            "finger",
            "thumb thumbs index middle mid ring pinky pinkie little digit",
            "finger carpal thumb daumen pinky",
        ),
        (
            "face",
            "eye eyes eyeball eyelid jaw tongue teeth brow eyebrow lip lips cheek nose ear mouth hair face lid chin"
            " auge augen kiefer zunge mund nase haar ohr",
            "smplhf",
        ),
        ("arm", "", "schluesselbein schlusselbein"),  # before "bein", a leg
        (
            "leg",
            "leg legs toe toes ball bein zeh zehe zehen fuss fus ferse ballen ashi momo sune",
            "thigh upleg knee shin calf foot feet ankle buttock femur tibia hipjoint heel schenkel knie knoechel"
            " knochel sprunggelenk hiza ashikubi tsumasaki",
        ),
        ("leg", "lowleg lowerleg upperleg toebase", ""),
        (
            "arm",
            "arm arms radius ulna ude hiji te kata",
            "shoulder shldr clavicle collar upperarm forearm lowerarm uparm elbow wrist hand humerus scapula palm"
            " schulter oberarm unterarm ellbogen ellenbogen tekubi",
        ),
        ("hip", "hip hips pelvis becken koshi", "huefte hufte"),
        ("head", "head skull kopf atama", ""),
        ("neck", "hals kubi", "neck nacken"),
        (
            "trunk",
            "back lowback brust bauch taille rumpf mune vertebra",
            "spine chest abdomen torso waist thorax lowerback upperback trunk stomach belly wirbel ruecken rucken"
            " brustkorb",
        ),
    )
)

# Vicon's segments: two letters after the letter of the side (LFE is the left femur). Matched whole, in capitals.
VICON_SEGMENTS = {
    "FE": "femur", "TI": "tibia", "FO": "foot", "TO": "toes", "CL": "clavicle", "HU": "humerus", "RA": "radius",
    "HN": "hand",
}  # fmt: skip

# Japanese words in the spelling of MikuMikuDance and studios, the longest first, since names have no blanks.
JAPANESE = tuple(
    sorted(
        {
            "左": " left ", "右": " right ", "上半身": " spine ", "下半身": " hip ",
            "骨盤": " pelvis ", "腰": " hip ",
            "脊椎": " spine ", "背骨": " spine ", "背中": " back ", "胸": " chest ", "腹": " belly ", "首": " neck ",
            "頭": " head ", "鎖骨": " clavicle ", "肩": " shoulder ", "上腕": " upperarm ", "前腕": " forearm ",
            "腕": " arm ", "ひじ": " elbow ", "肘": " elbow ",
            "手首": " wrist ", "手のひら": " palm ", "手": " hand ",
            "太もも": " thigh ", "大腿": " thigh ", "腿": " thigh ", "下腿": " shin ", "すね": " shin ",
            "ひざ": " knee ", "膝": " knee ", "足首": " ankle ", "足": " leg ", "脚": " leg ", "つま先": " toe ",
            "爪先": " toe ", "かかと": " heel ", "親指": " thumb ", "人差し指": " index ", "人差指": " index ",
            "人指": " index ", "中指": " middle ", "薬指": " ring ", "小指": " little ", "指": " finger ",
            "目": " eye ", "眉": " eyebrow ", "舌": " tongue ", "顎": " jaw ", "髪": " hair ", "口": " mouth ",
            "捩": " twist ", "捻": " twist ", "スカート": " skirt ", "先": " tip ", "キャンセル": " helper ",
            "ダミー": " dummy ",
        }.items(),
        key=lambda item: -len(item[0]),
    )
)  # fmt: skip
