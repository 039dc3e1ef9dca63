"""What `pumps infill` warns of: rows outside the keys, keys too far apart, channels that jump, frame rates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.infill.config import Config
from stages.infill.request import request_of
from stages.infill.row_files import row_file
from stages.inspect.config import Config as InspectConfig
from stages.inspect.run import run as inspect
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.sources import source_named
from stages.shared.kinematics.gap_speed import LIMB_MPS, PELVIS_MPS, sentences_of_speed
from tests.shared.formats.bvh_texts import BvhText


def config_of(tmp_path, **options) -> Config:
    return Config(input=tmp_path / "in.bvh", output=tmp_path / "out.bvh", **options)


def test_rows_outside_the_keys_are_named(tmp_path):
    both = request_of(config_of(tmp_path, keyframes="30,60"), 152, 30.0)
    assert [note for note in both.notes if "0-29 and 61-151" in note]
    after = request_of(config_of(tmp_path, keyframes="0,60"), 152, 30.0)
    assert [note for note in after.notes if "Rows 61-151 " in note]
    for options in ({"keyframes": "every:15"}, {"transition": "30:60"}, {"predict": 5}):
        assert not request_of(config_of(tmp_path, **options), 152, 30.0).notes
    late = request_of(config_of(tmp_path, frames="2,15"), 2, 30.0)
    assert [note for note in late.notes if "0-1" in note]


def test_times_that_a_slow_rate_cannot_hold_name_the_rate(tmp_path):
    options = config_of(tmp_path, times="0,0.5,1,1.5")
    with pytest.raises(InputError, match="1 frames a second") as raised:
        request_of(options, 4, 1.0)
    assert "--fps-override" in (raised.value.hint or "")
    assert request_of(options, 4, 30.0).keys.tolist() == [0, 15, 30, 45]
    with pytest.raises(InputError, match="must rise"):
        request_of(config_of(tmp_path, times="0,1,0.5,2"), 4, 30.0)


@pytest.mark.parametrize("line", ["Frame Time: 0.0416667", "FrameTime: 0.0416667"])
@pytest.mark.parametrize("rate, stated", [(29.476, 29.476), (24.0, 24.0), (None, 24.0)])
def test_the_given_frame_rate_is_written(tmp_path, line, rate, stated):
    text = BvhText(frames=5, frame_time="0.0416667").text().replace("Frame Time: 0.0416667", line)
    path = tmp_path / "in.bvh"
    path.write_text(text)
    options = config_of(tmp_path, keyframes="0,4", fps_override=rate)
    file = row_file(source_named(str(path)), options)
    keys = np.array([0, 4])
    file.key_motion(keys, ())
    _, motion, _ = motion_of(read_bvh(path.read_bytes(), "in"), fps_override=rate)
    data, _ = file.written(motion, 0, keys, keys, {0: 0, 4: 4}, 5)
    made = read_bvh(data, "out")
    assert 1 / made.frame_time == pytest.approx(stated, rel=1e-5)
    if rate != 29.476:
        assert line in made.motion_head  # the text stays


def test_inspect_does_not_ask_for_a_rate_that_was_given(tmp_path):
    path = tmp_path / "in.bvh"
    path.write_text(BvhText(frames=5, frame_time="0.0339259").text())
    for rate, asked in ((None, True), (29.476, False)):
        report = inspect(InspectConfig(input=str(path), fps_override=rate))
        assert any("--fps-override" in line for line in report.lines) == asked


def test_gaps_of_inhuman_speed_are_told_with_the_number():
    skeleton, motion, _ = motion_of(read_bvh(BvhText(frames=25).text().encode(), "in"))
    rotations = np.repeat(motion.rotations[:1], 25, 0)
    roots, keys = np.repeat(motion.root_positions[:1], 25, 0), np.array([0, 12, 24])
    still = replace(motion, rotations=rotations, root_positions=roots)
    assert sentences_of_speed(skeleton, still, keys, 0) == []
    roots[13:, 0] += np.minimum(np.arange(12), 5) * 6.0 / still.fps
    (sentence,) = sentences_of_speed(skeleton, still, keys, 100)
    assert "6.0 m/s in frames 113-123" in sentence and "101" not in sentence
    assert sentences_of_speed(skeleton, still, np.arange(25), 0) == []  # no gap
    roots[13:, 0] = roots[0, 0] + np.minimum(np.arange(12), 5) * 2.0 / still.fps
    assert sentences_of_speed(skeleton, still, keys, 0) == []
    assert 4.0 < PELVIS_MPS < 5.5 < LIMB_MPS
