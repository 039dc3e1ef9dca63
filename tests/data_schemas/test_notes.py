"""Codes of what was odd in a recording, and the sentences that are made from them."""

import pickle

import pytest

from data_schemas.notes import Flag, flags_text, note, sentences_of

FIGURES = {
    Flag.FPS_OVERRIDE: {"fps": 60.0},
    Flag.TRIMMED: {"frames": 2, "calibration": True},
    Flag.FRAMES_LINE_OFF: {"declared": 41, "found": 40},
    Flag.ROWS_JOINED: {"lines": 90, "rows": 30},
    Flag.FRAMES_MISSING: {"frame": 2.0, "following": 4.0},
    Flag.UNEVEN_FRAMES: {"fps": 30.0},
    Flag.ONE_FRAME_CLIPS: {"clips": 3},
    Flag.SIDES_FROM_POSE: {"clear": False},
    Flag.UNIT_UNCERTAIN: {"unit_m": 0.0254, "stature_m": 1.7, "scaled": False},
    Flag.PLACES_INTERPOLATED: {"places": 5},
    Flag.OTHER_SKINS: {"joints": 4},
    Flag.COLUMNS_LEFT_OUT: {"where": "rig.bvh", "left_out": "Hat, Cape", "without": "Head"},
    Flag.ROTATIONS_LEFT_OUT: {"columns": 63},
    Flag.NO_FRAME_RATE: {"fps": 120.0},
    Flag.NO_GENDER: {"pickled": True},
    Flag.UP_FROM_MOTION: {"up_axis": "y", "stands": True},
}


@pytest.mark.parametrize("flag", Flag)
def test_every_code_has_a_sentence_of_its_figures(flag):
    figures = FIGURES.get(flag, {})
    (sentence,) = sentences_of([note(flag, **figures)])
    assert sentence[0] == sentence[0].upper() and sentence.endswith(".") and sentence.count(". ") == 0
    for value in figures.values():
        texts = {value, value.upper()} if isinstance(value, str) else {f"{value:g}"}
        assert isinstance(value, bool) or any(text in sentence for text in texts)


def test_codes_are_short_words_that_a_column_can_hold():
    values = [flag.value for flag in Flag]
    assert len(set(values)) == len(values) and not any(" " in value for value in values)
    assert flags_text([Flag.TRIMMED, Flag.FPS_OVERRIDE, Flag.TRIMMED]) == "trimmed fps-override"
    assert {"trimmed"} == {Flag.TRIMMED}  # a code read from a table is found among the codes


def test_notes_are_equal_by_code_and_figures_and_travel_between_processes():
    one = note(Flag.TRIMMED, frames=1, calibration=True)
    assert one == note(Flag.TRIMMED, calibration=True, frames=1) != note(Flag.TRIMMED, frames=2, calibration=True)
    assert pickle.loads(pickle.dumps(one)) == one and len({one, pickle.loads(pickle.dumps(one))}) == 1
    assert str(one) == "Dropped the first frame: a calibration pose and the motion that leads out of it."
