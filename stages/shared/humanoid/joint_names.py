"""The meaning of joint names: side, part of the body, and whether the joint is a finger, a face part or a helper.

Covers the spellings of LaFAN1, CMU (BVH and ASF), DAZ, Mixamo, Xsens, Rokoko, 3ds Max Biped, Unreal, VRM, SMPL,
Vicon, Bandai Namco, Character Creator, URDF robots, and German and Japanese names. A name need not have a meaning:
`stages.shared.humanoid.body_groups` then uses topology.
"""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache
from typing import NamedTuple

from stages.shared.humanoid.joint_vocabulary import JAPANESE, PARTS, VICON_SEGMENTS

LEFT, RIGHT = "left", "right"
_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
_SIDES = {
    "l": LEFT, "left": LEFT, "lft": LEFT, "lf": LEFT, "lt": LEFT, "links": LEFT, "li": LEFT, "hidari": LEFT,
    "linke": LEFT, "linker": LEFT, "linkes": LEFT,
    "r": RIGHT, "right": RIGHT, "rgt": RIGHT, "rt": RIGHT, "rechts": RIGHT, "re": RIGHT, "migi": RIGHT,
    "rechte": RIGHT, "rechter": RIGHT, "rechtes": RIGHT,
}  # fmt: skip
_JOINED_SIDES = (
    ("left", LEFT), ("right", RIGHT), ("links", LEFT), ("rechts", RIGHT), ("hidari", LEFT), ("migi", RIGHT),
    ("l", LEFT), ("r", RIGHT),
)  # fmt: skip
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"})
_OWN_START = re.compile(r"leg|ring|radius|rumpf|ruecken|rucken|little|lower|lip|lid|root|roll|lash")
_VERTEBRA = re.compile(r"(?:^|[_ ])[LTC]\d{1,2}$")
_VICON = re.compile(rf"^([LR])({'|'.join(VICON_SEGMENTS)})$")


class NameSense(NamedTuple):
    """side: "left", "right" or "". part: "leg", "arm", "hip", "head", "neck", "trunk", "finger", "face", "end",
    "helper" or "". middle: True for a middle finger. thumb: True for a thumb. words: the name without its side, in
    lower case: equal for the two joints of a pair."""

    side: str
    part: str
    middle: bool = False
    thumb: bool = False
    words: tuple[str, ...] = ()


@lru_cache(maxsize=4096)
def sense_of(name: str) -> NameSense:
    """The meaning of a joint's name."""
    bare = re.sub(r"^mixamorig\d*_?", "", name.rsplit(":", 1)[-1])
    if _VERTEBRA.search(bare):  # Xsens' vertebrae L5, L3, T12, T8: L is not "left" here
        return NameSense("", "trunk", words=("vertebra", bare.lower()))
    vicon = _VICON.match(bare)
    if vicon:
        bare = f"{vicon[1]} {VICON_SEGMENTS[vicon[2]]}"
    side, words = "", []
    for word in (word.lower() for word in _WORDS.findall(_in_latin(bare))):
        if word in _SIDES:
            side = side or _SIDES[word]
            continue
        found, rest = _split_side(word)
        side = side or found
        words.append(rest)
    part = _part_of(words)
    if part == "hip" and side:
        part = "leg"
    digits = tuple(re.findall(r"\d+", bare))
    middle = any(word.startswith("middle") or word in ("mid", "mittelfinger") for word in words)
    thumb = any("thumb" in word or "daumen" in word for word in words)
    return NameSense(side, part, middle, thumb, (*words, *digits))


def has_a_tail(names: tuple[str, ...]) -> bool:
    """Whether a joint is named a tail, a sign of an animal (callers also check the posture)."""
    return any("tail" in sense_of(name).words for name in names)


def _in_latin(name: str) -> str:
    """The name with Japanese words translated and German umlauts spelled out."""
    if name.isascii():
        return name
    name = unicodedata.normalize("NFKC", name).translate(_UMLAUTS)
    for word, english in JAPANESE:
        name = name.replace(word, english)
    return name


def _split_side(word: str) -> tuple[str, str]:
    """The side that is part of a word ("lfemur", "leftupleg", "handlinks"), if the rest is a known word."""
    for written, side in _JOINED_SIDES:
        known = _part_of([word]) if len(written) == 1 else ""
        if word.startswith(written) and len(word) > len(written) + 2:
            rest = word[len(written) :]
            if _part_of([rest]) and not _same_start(word, known):
                return side, rest
        if len(written) > 1 and word.endswith(written) and _part_of([word[: -len(written)]]):
            return side, word[: -len(written)]
    return "", word


def _same_start(word: str, known: str) -> bool:
    """True for words whose own first letter is l or r ("leg", "ring", "radius", "little", "lowerarm", "lips")."""
    return bool(known) and _OWN_START.match(word) is not None


def _part_of(words: list[str]) -> str:
    for part, whole, inside in PARTS:
        if any(word in whole or any(piece in word for piece in inside) for word in words):
            return part
    return ""
