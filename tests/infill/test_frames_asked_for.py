"""How many frames a request may ask for depends on the rows that are there, and is asked before any is made."""

from __future__ import annotations

import pytest

from data_schemas.errors import PumpsError
from stages.infill.config import Config
from stages.infill.request import MOST_FRAMES, most_frames, request_of


def _request(tmp_path, rows: int, **settings):
    return request_of(Config(input=tmp_path / "a.bvh", output=tmp_path / "b.bvh", **settings), rows, 30.0)


@pytest.mark.parametrize(
    ("rows", "settings", "words"),
    [
        (100, {"predict": 10_000_000}, "10000100 frames of 100"),
        (100, {"predict": 100_000}, "Give at most 99900"),
        (2, {"frames": "0,9999999"}, "10000000 frames between 2 keys"),
        (2, {"times": "0,300000"}, "9000001 frames between 2 keys"),
        (50_000, {"predict": 2 * MOST_FRAMES}, "frames of 50000"),
    ],
)
def test_more_frames_than_the_input_explains_are_refused(tmp_path, rows, settings, words):
    with pytest.raises(PumpsError) as caught:
        _request(tmp_path, rows, **settings)
    assert words in str(caught.value)


def test_long_requests_of_long_inputs_are_met(tmp_path):
    assert _request(tmp_path, 100, predict=99_900).frames == most_frames(100)
    assert _request(tmp_path, 20_000, predict=100_000).frames == 120_000
    assert _request(tmp_path, 2, frames="0,99999").frames == 100_000
    assert most_frames(3 * MOST_FRAMES) == 3 * MOST_FRAMES  # a long file may always be filled
