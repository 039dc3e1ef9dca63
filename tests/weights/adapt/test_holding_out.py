"""Recordings held out of an adaptation: whole clips, or an end that no training window reaches."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_schemas.errors import InputError
from stages.shared.statistics.windows import LEAST_FRAMES
from stages.weights.adapt.holding_out import SPAN, hold_out, spans_of

LENGTHS = st.lists(st.integers(2, 2000), min_size=1, max_size=12)


@given(LENGTHS, st.integers(8, 128), st.integers(0, 9))
def test_no_frame_is_in_both_and_a_window_lies_between(lengths: list[int], window: int, seed: int):
    try:
        parts = hold_out(lengths, window, seed)
    except InputError:
        assert max(lengths) < 3 * LEAST_FRAMES + window or len(lengths) > 1
        return
    held = [part for part in parts if part.held_out]
    trained = [part for part in parts if not part.held_out]
    assert 2 * sum(part.frames for part in held) <= sum(lengths) + 4 * LEAST_FRAMES
    assert max(part.frames for part in trained) >= LEAST_FRAMES
    assert len(spans_of([part.frames for part in held])) > 1
    for part in parts:
        assert 0 <= part.start < part.stop <= lengths[part.clip]
    for one in trained:
        for other in held:
            assert one.clip != other.clip or other.start - one.stop >= window


def test_whole_clips_are_held_out_where_there_are_several():
    parts = hold_out([300] * 8, 96, seed=0)
    assert [(part.start, part.stop) for part in parts] == [(0, 300)] * 8
    assert sum(part.held_out for part in parts) == 2


def test_the_end_of_a_single_clip_is_held_out():
    trained, held = hold_out([1000], 96, seed=0)
    assert (trained.start, held.stop) == (0, 1000) and held.frames == 250 and held.start - trained.stop == 96


def test_short_recordings_are_refused_with_what_is_needed():
    with pytest.raises(InputError, match=r"has 6\.7 seconds, and 7\.8 are needed") as caught:
        hold_out([200], 96, seed=0)
    assert "several of at least 3.1 seconds" in str(caught.value.hint)


@given(st.lists(st.integers(2, 1000), min_size=1, max_size=6))
def test_spans_fit_and_do_not_overlap(lengths: list[int]):
    ends = dict.fromkeys(range(len(lengths)), 0)
    for number, start, frames in spans_of(lengths):
        assert ends[number] <= start and start + frames <= lengths[number] and LEAST_FRAMES <= frames <= SPAN
        ends[number] = start + frames
