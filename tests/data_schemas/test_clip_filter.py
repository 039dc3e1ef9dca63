"""Choosing clips by an expression: what it means, and that nothing else gets through."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.clip_filter import clips_where
from data_schemas.clips import ClipRow
from data_schemas.errors import UsageError
from data_schemas.quality import MotionQuality


def _row(clip: str, source: str = "data/walks.zip!a.bvh", split: str = "train", **quality: float) -> ClipRow:
    row = ClipRow(clip, source, "0" * 64, "s", 60, 30.0, 2.0, split, "free")
    return replace(row, quality=MotionQuality(**quality))  # type: ignore[arg-type]


ROWS = [
    _row("still", foot_skate=0.01, t_pose=True),
    _row("walk", foot_skate=0.05),
    _row("slide", "data/other.zip!b.bvh", foot_skate=0.3, spikes=4),
    _row("unknown", "data/other.zip!c.bvh", "val"),
]


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (None, ["still", "walk", "slide", "unknown"]),
        ("  ", ["still", "walk", "slide", "unknown"]),
        ("foot_skate < 0.1", ["still", "walk"]),
        ("foot_skate < 0.1 and not t_pose", ["walk"]),
        ("t_pose", ["still"]),
        ("t_pose == true or spikes > 3", ["still", "slide"]),
        ("0.02 <= foot_skate < 0.4", ["walk", "slide"]),
        ('archive == "other.zip"', ["slide", "unknown"]),
        ('split in ["val", "test"]', ["unknown"]),
        ('clip not in ["walk"] and (frames >= 60)', ["still", "slide", "unknown"]),
        ("foot_skate > -1", ["still", "walk", "slide"]),
    ],
)
def test_what_expressions_mean(expression: str | None, expected: list[str]):
    assert [row.clip for row in clips_where(ROWS, expression)] == expected


@pytest.mark.parametrize(
    "expression",
    [
        "__import__('os').system('true')", "foot_skate.__class__", "[x for x in ()]", "lambda: 1", "foot_skate < ",
        "1", "true", "foot_skatee < 1", "clip < 3", "foot_skate in 3", "f'{clip}' == 'a'", "split is 'val'",
        "(" * 500 + ")" * 500, "t_pose and " * 400 + "t_pose", "9" * 1999, "foot_skate < 1e999 and clip == b'x'",
        "-''", "not 'text'", "'a' and 'b'", "1 in [2]", "clip == -'walk'",
    ],
)  # fmt: skip
def test_invalid_expressions_are_refused_in_one_sentence(expression: str):
    with pytest.raises(UsageError) as refused:
        clips_where(ROWS, expression)
    assert len(str(refused.value)) < 1500


def test_an_expression_that_nothing_satisfies_says_so():
    with pytest.raises(UsageError, match="No clip satisfies"):
        clips_where(ROWS, "frames > 1000")


@settings(max_examples=200, deadline=None)
@given(st.text(alphabet="foot_skate t_pose andornot<>=!().,[]\"'0123456789-+*/:{}\\\n", max_size=60))
def test_no_text_does_anything_but_choose_or_be_refused(expression: str):
    try:
        kept = clips_where(ROWS, expression)
    except UsageError:
        return
    assert set(kept) <= set(ROWS)
