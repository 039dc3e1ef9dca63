"""Keyframe texts: what they name, and how they are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_schemas.errors import InputError, PumpsError, UsageError
from stages.shared.inference.keyframes import parse_keyframes, parse_transition


@pytest.mark.parametrize(
    ("text", "frames", "expected"),
    [
        ("0,15,40", 41, [0, 15, 40]),
        ("40, 0 15,15", 41, [0, 15, 40]),
        ("every:15", 40, [0, 15, 30, 39]),
        ("every:15", 31, [0, 15, 30]),
        ("every:900", 31, [0, 30]),
        ("37:", 41, [37, 38, 39, 40]),
        (":3", 41, [0, 1, 2]),
        ("10:14,0,-1", 20, [0, 10, 11, 12, 13, 19]),
        ("0:20:5", 20, [0, 5, 10, 15]),
        (":-17", 20, [0, 1, 2]),
        (":", 3, [0, 1, 2]),
        ("10:20", 20, list(range(10, 20))),
    ],
)
def test_names(text: str, frames: int, expected: list[int]):
    assert parse_keyframes(text, frames).tolist() == expected


@pytest.mark.parametrize(
    "text", ["", " , ", "a", "1.5", "every", "every:0", "every:-3", "1-5", "0:9:0", "1:2:3:4", "²"]
)
def test_refuses_what_it_cannot_read(text: str):
    with pytest.raises(UsageError):
        parse_keyframes(text, 10)


@pytest.mark.parametrize("text", ["10", "-11", "0,99", "5:11", "10:", "6:6", "7:3", "5:0"])
def test_refuses_frames_that_are_not_there(text: str):
    with pytest.raises(InputError):
        parse_keyframes(text, 10)


def test_refuses_empty_clip():
    with pytest.raises(InputError):
        parse_keyframes("every:15", 0)


@given(st.text(alphabet="0123456789:,- evry", max_size=20), st.integers(0, 50))
def test_answers_or_refuses(text: str, frames: int):
    try:
        keys = parse_keyframes(text, frames)
    except PumpsError:
        return
    assert len(keys) >= 1 and keys.min() >= 0 and keys.max() < frames and (np.diff(keys) > 0).all()


@given(st.lists(st.integers(0, 99), min_size=1, max_size=30))
def test_names_the_numbers_given(numbers: list[int]):
    assert parse_keyframes(",".join(map(str, numbers)), 100).tolist() == sorted(set(numbers))


def test_transition():
    assert parse_transition("2:4", 6).tolist() == [0, 1, 4, 5]
    for text in ("0:4", "2:6", "4:2", "2:60"):
        with pytest.raises(InputError):
            parse_transition(text, 6)
    for text in ("2", "2:", "a:b", "2:4:1"):
        with pytest.raises(UsageError):
            parse_transition(text, 6)
