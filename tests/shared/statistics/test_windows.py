"""Which frames are measured, and which of them are known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.shared.statistics.windows import Task, Window, chosen_windows, clip_windows


def test_known_frames_of_each_task() -> None:
    assert np.flatnonzero(Task("interpolation", 30, 121).known(121)).tolist() == [0, 30, 60, 90, 120]
    assert np.flatnonzero(Task("interpolation", 30, 121).known(70)).tolist() == [0, 30, 60, 69]
    transition = Task("transition", 60, 121)
    assert transition.frames == 90
    assert np.flatnonzero(~transition.known(90)).tolist() == list(range(15, 75))
    lafan1 = Task("transition", 5, 121, (10, 1))
    assert lafan1.frames == 16
    assert np.flatnonzero(~lafan1.known(16)).tolist() == list(range(10, 15))
    assert np.flatnonzero(~Task("prediction", 15, 121).known(121)).tolist() == list(range(106, 121))


@pytest.mark.parametrize(
    ("task", "interval", "clip_frames", "expected"),
    [
        ("interpolation", 15, 121, 121),
        ("interpolation", 15, 120, 120),
        ("interpolation", 15, 46, 46),
        ("interpolation", 15, 45, 0),
        ("transition", 60, 89, 0),
        ("transition", 15, 45, 45),
        ("prediction", 30, 50, 50),
        ("prediction", 30, 31, 0),
        ("interpolation", 60, 50, 0),
    ],
)
def test_frames_of_a_window_in_a_short_clip(task: str, interval: int, clip_frames: int, expected: int) -> None:
    assert Task(task, interval, 121).frames_in(clip_frames) == expected


@given(frames=st.integers(1, 3000), window=st.integers(46, 200))
def test_windows_stay_inside_and_never_overlap(frames: int, window: int) -> None:
    windows = clip_windows("c", frames, Task("interpolation", 15, window))
    assert bool(windows) == (frames >= 46)
    for before, after in pairwise(windows):
        assert before.start + before.frames <= after.start
    if windows:
        assert windows[0].start >= 0 and windows[-1].start + windows[-1].frames <= frames
        assert len(windows) == max(1, frames // windows[0].frames)
        if len(windows) > 1:
            assert windows[0].start == 0 and windows[-1].start + windows[-1].frames == frames


@given(lengths=st.lists(st.integers(0, 12), max_size=30), limit=st.integers(1, 60))
def test_a_limit_is_met_and_spread_over_clips(lengths: list[int], limit: int) -> None:
    by_clip = [[Window(str(c), 121 * i, 121) for i in range(n)] for c, n in enumerate(lengths)]
    chosen = chosen_windows(by_clip, limit)
    assert len(chosen) == len(set(chosen)) == min(limit, sum(lengths))
    filled = sum(n > 0 for n in lengths)
    assert len({w.clip for w in chosen}) == min(limit, filled)


def test_single_windows_come_from_different_places_of_their_clips() -> None:
    by_clip = [[Window(str(c), 121 * i, 121) for i in range(10)] for c in range(8)]
    assert len({w.start for w in chosen_windows(by_clip, 8)}) >= 5


def test_no_limit_takes_all() -> None:
    by_clip = [[Window("a", 0, 121)], [], [Window("b", 0, 121), Window("b", 121, 121)]]
    assert len(chosen_windows(by_clip, 0)) == 3
