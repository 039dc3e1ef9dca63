"""Anchors from chances: how far apart, how many, and the limit that finds as many as there are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.shared.inference.anchor_chances import APART, balanced_limit, chosen_anchors, taper, windows_of

CHANCES = st.lists(st.integers(1, 999), min_size=8, max_size=60).map(lambda found: np.array(found) / 1000)


@given(chances=CHANCES, limit=st.floats(0.01, 0.99))
def test_anchors_are_the_ends_and_likely_frames_apart(chances: np.ndarray, limit: float) -> None:
    anchors = chosen_anchors(chances, limit)
    assert anchors[0] == 0 and anchors[-1] == len(chances) - 1 and (np.diff(anchors) >= APART).all()
    assert (chances[anchors[1:-1]] > limit).all()


@given(several=st.lists(CHANCES, min_size=1, max_size=4), share=st.floats(0, 1))
def test_the_limit_is_the_highest_that_finds_as_many_as_there_are(several: list[np.ndarray], share: float) -> None:
    def found(limit: float) -> int:
        return sum(len(chosen_anchors(each, limit)) for each in several)

    asked = 2 * len(several) + int(share * (found(0.01) - 2 * len(several)))
    limit = balanced_limit(several, asked)
    assert found(limit) >= asked
    assert all(found(higher) < asked for higher in np.arange(1, 100) / 100 if higher > limit)


def test_low_chances_with_clear_peaks_are_found() -> None:
    """A recogniser whose chances never pass 0.5."""
    chances = np.full(60, 0.05)
    chances[[12, 30, 47]] = (0.3, 0.25, 0.2)
    assert list(chosen_anchors(chances, 0.5)) == [0, 59]
    assert list(chosen_anchors(chances, balanced_limit([chances], 5))) == [0, 12, 30, 47, 59]


@pytest.mark.parametrize(("frames", "window"), [(5, 8), (8, 8), (9, 8), (61, 16)])
def test_windows_cover_a_sequence(frames: int, window: int) -> None:
    weight = np.zeros(frames)
    for start, size in windows_of(frames, window):
        weight[start : start + size] += taper(size)
    assert (weight > 0).all() and len(weight) == frames
