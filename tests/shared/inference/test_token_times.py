"""Token times: keys at their exact times, a clock between them, no crowding."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.shared.inference.token_times import CLEARANCE, choose_tokens


def test_at_thirty_frames_a_second_tokens_are_frames():
    tokens = choose_tokens(np.array([0, 15, 20, 30]), 31, 30.0)
    np.testing.assert_array_equal(tokens.times, np.arange(31))
    assert np.flatnonzero(tokens.is_key).tolist() == [0, 15, 20, 30]


def test_key_between_ticks_keeps_its_time():
    tokens = choose_tokens(np.array([0, 15, 40]), 41, 120.0)
    assert tokens.times[tokens.is_key].tolist() == [0.0, 3.75, 10.0]
    assert tokens.times.tolist() == [0, 1, 2, 3, 3.75, 5, 6, 7, 8, 9, 10]


def test_prediction_reaches_the_last_frame():
    tokens = choose_tokens(np.arange(40), 83, 120.0)
    assert tokens.times[-1] == 82 / 4 and not tokens.is_key[-1]
    assert tokens.is_key[tokens.times <= 39 / 4].all()


@given(st.sets(st.integers(0, 199), min_size=1), st.sampled_from([24.0, 25.0, 29.97, 30.0, 60.0, 100.0, 120.0, 12.0]))
def test_properties(keys: set[int], fps: float):
    frames = np.array(sorted(keys))
    tokens = choose_tokens(frames, 200, fps)
    assert (np.diff(tokens.times) > 0).all()
    # Tokens called keys are keys, and every key beside a missing frame is there.
    at = tokens.times[tokens.is_key] * fps / 30
    np.testing.assert_allclose(at, np.rint(at), atol=1e-6)
    assert set(np.rint(at).astype(int)) <= keys
    edges = {k for k in keys if {k - 1, k + 1} & set(range(200)) - keys}
    assert edges <= set(np.rint(at).astype(int))
    free = ~tokens.is_key[1:] | ~tokens.is_key[:-1]
    if fps <= 60:  # above, the clip's last frame may crowd the clock
        assert (np.diff(tokens.times)[free] >= min(CLEARANCE, 30 / fps) - 1e-9).all()
    gaps = np.setdiff1d(np.arange(200), frames)
    near = tokens.nearest(gaps)
    assert ((near >= 0) & (near < len(tokens.times))).all()
    assert sum(len(gap) for gap in tokens.gaps()) == (~tokens.is_key).sum()


@pytest.mark.parametrize("frames", [1, 2])
def test_tiny_clips(frames: int):
    tokens = choose_tokens(np.array([0]), frames, 30.0)
    assert len(tokens.times) == frames
