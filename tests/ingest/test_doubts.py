"""Warnings about a collection as a whole."""

from __future__ import annotations

from data_schemas.clips import ClipRow
from data_schemas.quality import MotionQuality
from stages.ingest.doubts import doubts_of


def _rows(folder: str, speeds: list[float], **quality: float) -> list[ClipRow]:
    return [
        ClipRow(
            f"{folder}-{i}", f"a.zip!{folder}/{i}.bvh", "0" * 64, "s", 60, 120.0, 0.5, "train", "free",
            quality=MotionQuality(speed_log2=speed, **quality),  # type: ignore[arg-type]
        )
        for i, speed in enumerate(speeds)
    ]  # fmt: skip


def test_a_folder_that_plays_too_fast_is_reported_by_name():
    lines = doubts_of(_rows("salsa", [0.9, 0.3, 0.7, 1.1, 0.4]) + _rows("walks", [0.1, -0.3, 0.2, 0.0, 0.5]))
    assert len(lines) == 1
    assert "5 clips in a.zip/salsa" in lines[0] and "too fast" in lines[0] and "*salsa*=60" in lines[0]


def test_few_or_mixed_clips_are_not_reported():
    assert doubts_of(_rows("salsa", [0.9, 0.9])) == []
    assert doubts_of(_rows("mixed", [0.9, -0.9, 0.9, -0.9, 0.2, 0.1])) == []


def test_a_few_acrobatics_do_not_make_a_frame_rate_wrong():
    speeds = [1.8, 0.5, 0.0, 0.5, 0.3, 0.0, -0.1, 0.0, 1.0, 0.4, 0.9, 0.6, 0.6, 1.2, 0.3]
    assert sum(speeds) / len(speeds) > 0.5 and doubts_of(_rows("clips", speeds)) == []


def test_faults_are_counted():
    rows = _rows("walks", [0.0], t_pose=True) + _rows("more", [0.0, 0.0], flips=3) + _rows("good", [0.0])
    (line,) = doubts_of(rows)
    assert line.startswith("Of 4 clips, 1 hold a T-pose; 2 have joints that jump")
