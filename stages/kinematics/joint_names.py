"""What joint names say: side, part of the body, and whether the joint is a finger, a face part or a helper.

Covers the spellings of Bandai Namco, DAZ, Mixamo, LaFAN1, Biped, Unreal, CMU's ASF, SMPL and URDF robots; a name that
says nothing is no fault, `stages.kinematics.body_groups` then goes by topology.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import NamedTuple

LEFT, RIGHT = "left", "right"
_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
_SIDES = {"l": LEFT, "left": LEFT, "lft": LEFT, "lf": LEFT, "r": RIGHT, "right": RIGHT, "rgt": RIGHT, "rt": RIGHT}

# Part, words that are it outright, and longer words that may stand inside another ("lefthand", "forearm").
# Tried in this order: a finger's name often holds the hand's, a toe's the foot's.
_PARTS = tuple(
    (part, frozenset(whole.split()), tuple(inside.split()))
    for part, whole, inside in (
        ("end", "end nub nubs site tip tips headtop toptip", ""),
        ("helper", "ik prop gun tail cape", "twist helper dummy pole weapon sword attach socket breast skirt"),
        ("finger", "thumb thumbs index middle mid ring pinky pinkie little", "finger carpal"),
        (
            "face",
            "eye eyes eyeball eyelid jaw tongue teeth brow eyebrow lip lips cheek nose ear mouth hair face lid chin",
            "",
        ),
        (
            "leg",
            "leg legs toe toes ball",
            "thigh upleg knee shin calf foot feet ankle buttock femur tibia hipjoint heel",
        ),
        ("leg", "lowleg lowerleg upperleg toebase", ""),
        (
            "arm",
            "arm arms radius ulna",
            "shoulder shldr clavicle collar upperarm forearm lowerarm uparm elbow wrist hand humerus scapula palm",
        ),
        ("hip", "hip hips pelvis", ""),
        ("head", "head skull", ""),
        ("neck", "", "neck"),
        ("trunk", "back lowback", "spine chest abdomen torso waist thorax lowerback upperback trunk stomach belly"),
    )
)


class NameSense(NamedTuple):
    """side: "left", "right" or "". part: "leg", "arm", "hip", "head", "neck", "trunk", "finger", "face", "end",
    "helper" or "". middle: True for a middle finger. thumb: True for a thumb."""

    side: str
    part: str
    middle: bool = False
    thumb: bool = False


@lru_cache(maxsize=4096)
def sense_of(name: str) -> NameSense:
    """What a joint's name says of it."""
    bare = re.sub(r"^mixamorig\d*_?", "", name.rsplit(":", 1)[-1])
    side, words = "", []
    for word in (word.lower() for word in _WORDS.findall(bare)):
        if word in _SIDES:
            side = side or _SIDES[word]
            continue
        found, rest = _split_side(word)
        side = side or found
        words.append(rest)
    part = _part_of(words)
    if part == "hip" and side:
        part = "leg"
    return NameSense(side, part, "middle" in words or "mid" in words, "thumb" in words)


def _split_side(word: str) -> tuple[str, str]:
    """Side written into the word itself: "lfemur", "leftupleg". Only where the remainder is a word we know."""
    for prefix, side in (("left", LEFT), ("right", RIGHT), ("l", LEFT), ("r", RIGHT)):
        rest = word[len(prefix) :]
        known = _part_of([word]) if len(prefix) == 1 else ""
        if word.startswith(prefix) and len(rest) > 2 and (_part_of([rest]) and not _same_start(word, known)):
            return side, rest
    return "", word


def _same_start(word: str, known: str) -> bool:
    """True for words that begin with l or r by themselves ("leg", "ring", "radius", "little", "lowerarm", "lips")."""
    return bool(known) and re.match(r"^(leg|ring|radius|little|lower|lip|lid|root|roll|lash)", word) is not None


def _part_of(words: list[str]) -> str:
    for part, whole, inside in _PARTS:
        if any(word in whole or any(piece in word for piece in inside) for word in words):
            return part
    return ""
