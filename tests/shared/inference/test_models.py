"""Weights in use: found by name or folder, whole, and run over clips of any length without a seam."""

import numpy as np
import pytest
import torch

from data_schemas.artefact import open_artefact, verify
from data_schemas.errors import InputError
from stages.shared.inference.models import (
    load_weights,
    overlapping_windows,
    window_seams,
)
from stages.shared.kinematics.runs import widened_to_keys
from stages.shared.weights.shipped import SHIPPED, shipped_weights, weights_folder


@pytest.mark.parametrize(("frames", "window"), [(1, 8), (8, 8), (9, 8), (50, 8), (200, 24), (31, 30)])
def test_windows_cover_every_frame_and_never_exceed_their_size(frames, window):
    weights = torch.zeros(frames)
    for start, stop, fade in overlapping_windows(frames, window):
        assert 0 <= start < stop <= frames
        assert stop - start == min(frames, window) == len(fade)
        assert (fade > 0).all()
        weights[start:stop] += fade
    assert (weights > 0).all()


def test_seams_are_the_frames_on_both_sides_of_where_windows_begin_and_end():
    assert window_seams(16, [8]).tolist() == [3, 4, 7, 8, 11, 12]  # windows 0-8, 4-12, 8-16
    assert window_seams(121, [96]).tolist() == [24, 25, 95, 96]
    assert len(window_seams(8, [8, 24])) == 0


def test_where_windows_meet_weights_fade_so_that_nothing_jumps():
    shares = []
    for start, stop, fade in overlapping_windows(100, 20):
        whole = torch.zeros(100)
        whole[start:stop] = fade
        shares.append(whole)
    shares = torch.stack(shares) / torch.stack(shares).sum(0)
    assert shares.diff(dim=1).abs().max() < 0.3


def test_a_window_is_widened_to_the_keys_at_both_ends_of_its_gaps():
    keys = np.array([0, 18, 39])
    assert widened_to_keys(keys, 5, 15) == (0, 19)
    assert widened_to_keys(keys, 20, 30) == (18, 40)
    assert widened_to_keys(keys[:2], 30, 40) == (18, 40)
    assert widened_to_keys(keys[1:], 2, 12) == (2, 19)


@pytest.mark.parametrize("name", shipped_weights())
def test_shipped_weights_are_whole_name_their_licences_and_load(name):
    for part in ("ae", "lms"):
        assert verify(SHIPPED / name / part) == []
    models = load_weights(name, "cpu")
    assert models.licences == tuple(open_artefact(SHIPPED / name / "lms").manifest.licences)
    card = (SHIPPED / name / "MODEL_CARD.md").read_text()
    assert models.licences and all(licence in card for licence in models.licences)
    assert models.trained_on in card


def test_small_free_is_shipped():
    assert "small-free" in shipped_weights()


def test_a_withdrawn_name_says_what_takes_its_place():
    with pytest.raises(InputError) as caught:
        weights_folder("tiny")
    assert "small-free" in str(caught.value)


def test_weights_that_are_not_there_are_named_with_those_that_are(tmp_path):
    with pytest.raises(InputError, match="small-free"):
        weights_folder(tmp_path / "none")
