"""What a manifest may hold: plain names, hex digests, texts and lists of bounded length.

Anybody can write a manifest, and its fields are shown on pages and terminals. These bounds lie far above what stages
write.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Any

from pydantic import AfterValidator, Field, StringConstraints

LONGEST_TEXT = 100_000  # characters of one text
LONGEST_PATH = 8192
MOST_FILES = 100_000
MOST_INPUTS = 1_000_000
MOST_LICENCES = 10_000
_MOST_VALUES = 5_000_000  # of config and summary together, nested ones too
_DEEPEST = 40
_LARGEST_WHOLE = 2**128

_SHA256 = re.compile(r"[0-9a-f]{64}")
_PLAIN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,79}")
_CREATOR = re.compile(r"pumps [0-9A-Za-z.+_-]{1,60}")


def is_sha256(text: str) -> bool:
    """Whether a text is a sha256 in lower-case hex."""
    return _SHA256.fullmatch(text) is not None


def is_plain_name(text: str) -> bool:
    """Whether a text is a short name of letters, digits, blanks, dots, dashes and underscores."""
    return _PLAIN_NAME.fullmatch(text) is not None


def _sha256(text: str) -> str:
    if not is_sha256(text):
        raise ValueError("is not a sha256 of 64 hex digits")
    return text


def _plain_name(text: str) -> str:
    if not is_plain_name(text):
        raise ValueError("is not a plain name of at most 80 letters, digits, dots and dashes")
    return text


def _creator(text: str) -> str:
    if not _CREATOR.fullmatch(text):
        raise ValueError("is not 'pumps' with a version")
    return text


def _path(text: str) -> str:
    if "\0" in text:
        raise ValueError("is not a path: it holds a zero byte")
    return text


def _plain_tree(values: dict[str, Any]) -> dict[str, Any]:
    """Check nested plain data without recursion: its depth, its number of values, each text and number."""
    waiting: list[tuple[Any, int]] = [(values, 0)]
    count = 0
    while waiting:
        value, depth = waiting.pop()
        count += 1
        if depth > _DEEPEST or count > _MOST_VALUES:
            raise ValueError(f"is deeper than {_DEEPEST} levels or has more than {_MOST_VALUES} values")
        if isinstance(value, dict):
            waiting += [(key, depth + 1) for key in value]
            waiting += [(inner, depth + 1) for inner in value.values()]
        elif isinstance(value, list):
            waiting += [(inner, depth + 1) for inner in value]
        elif isinstance(value, str):
            if len(value) > LONGEST_TEXT:
                raise ValueError(f"has a text of more than {LONGEST_TEXT} characters")
        elif isinstance(value, float):
            if not math.isfinite(value):
                raise ValueError("has a number that is not finite")
        elif isinstance(value, int):
            if abs(value) > _LARGEST_WHOLE:
                raise ValueError("has a whole number that is too large")
        elif value is not None:
            raise ValueError(f"has a {type(value).__name__}, which is not plain data")
    return values


Sha256 = Annotated[str, AfterValidator(_sha256)]
PlainName = Annotated[str, AfterValidator(_plain_name)]
Creator = Annotated[str, AfterValidator(_creator)]
InputPath = Annotated[str, StringConstraints(max_length=LONGEST_PATH), AfterValidator(_path)]
Licence = Annotated[str, StringConstraints(max_length=LONGEST_TEXT)]
Version = Annotated[int, Field(ge=-1_000_000, le=1_000_000)]
PlainTree = Annotated[dict[str, Any], AfterValidator(_plain_tree)]
