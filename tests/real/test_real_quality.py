"""The quality of real recordings: wrong frame rates are felt, sound ones are left alone."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from stages.ingest.doubts import TOGETHER
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.motion_quality import measure_quality
from stages.shared.kinematics.forward_numpy import positions_of

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(not (DATA / "cmu-dance.zip").exists(), reason="no recordings beside the project"),
]


def _speeds(archive: str, folder: str, count: int, fps: float | None) -> list[float]:
    speeds = []
    with zipfile.ZipFile(DATA / archive) as opened:
        members = [name for name in sorted(opened.namelist()) if name.endswith(".bvh") and folder in name][:count]
        for member in members:
            bvh = read_bvh(opened.read(member), member)
            skeleton, motion, _ = motion_of(bvh, fps_override=fps, trim_first="auto")
            found = measure_quality(skeleton, motion, positions_of(skeleton, motion))
            assert not found.swapped and found.flips == 0
            speeds.append(found.speed_log2 or 0.0)
    return speeds


def test_salsa_that_says_120_frames_a_second_and_has_60_is_felt():
    as_it_says, as_it_is = (np.mean(_speeds("cmu-dance.zip", "salsa", 10, fps)) for fps in (None, 60.0))
    assert as_it_says > TOGETHER > abs(as_it_is)


def test_sound_recordings_are_left_alone():
    assert abs(np.mean(_speeds("bandai-namco-1.zip", "", 12, None))) < TOGETHER
