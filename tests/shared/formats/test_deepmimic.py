"""DeepMimic clips: read, unrolled without a seam, written as BVH."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.deepmimic import bvh_of_deepmimic, motion_of_deepmimic, read_deepmimic, unrolled
from stages.shared.kinematics.forward import positions_of

CLIPS = Path(__file__).parents[3] / "stages" / "shared" / "clips"


def _clip(frames: int = 40, loop: str = "wrap", turn: float = 0.0) -> bytes:
    rows = []
    for i in range(frames):
        phase = 2 * np.pi * i / (frames - 1)
        heading = turn * i / (frames - 1)
        row = np.zeros(44)
        row[:4] = 1 / 30 if i < frames - 1 else 0.0, 1.2 * i / (frames - 1), 0.85 + 0.03 * np.cos(2 * phase), 0.0
        row[[8, 12, 16, 21, 25, 30, 35, 39]] = 1.0
        row[4:8] = np.cos(heading / 2), 0, np.sin(heading / 2), 0
        row[20], row[34] = -0.5 - 0.4 * np.cos(phase), -0.5 + 0.4 * np.cos(phase)
        rows.append(row.tolist())
    return json.dumps({"Loop": loop, "Frames": rows}).encode()


def test_the_pose_is_where_the_model_says() -> None:
    clip = read_deepmimic(_clip(), "walk")
    skeleton, motion = motion_of_deepmimic(clip)
    heads = positions_of(skeleton, motion)
    place = {name: heads[0, i] for i, name in enumerate(skeleton.names)}
    assert motion.fps == 30 and motion.frames == 40
    assert np.allclose(place["right_hip"] - place["root"], (0, 0, 0.084887), atol=1e-6)
    assert np.allclose(np.linalg.norm(place["left_knee"] - place["left_hip"]), 0.421546, atol=1e-5)
    bent = place["right_ankle"] - place["right_knee"]  # a negative knee angle takes the foot back, away from +X
    assert bent[0] == pytest.approx(-0.40987 * np.sin(0.9), abs=1e-4)
    assert skeleton.groups.tolist() == [0, 0, 0, 2, 2, 1, 1, 4, 4, 4, 3, 3, 3]


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_loops_go_on_without_a_seam(turn: float) -> None:
    clip = unrolled(read_deepmimic(_clip(turn=turn), "walk"), 4.0)
    skeleton, motion = motion_of_deepmimic(clip)
    assert motion.frames == 157
    heads = positions_of(skeleton, motion)
    bend = np.linalg.norm(np.diff(heads, n=2, axis=0), axis=-1).max(axis=1)
    assert bend.max() < 0.02  # metres a frame and frame
    ways = heads[[39, 78, 117], 0] - heads[[0, 39, 78], 0]
    assert np.allclose(np.linalg.norm(ways[:, [0, 2]], axis=1), 1.2, atol=1e-3)
    if turn:
        angles = np.arctan2(-ways[:, 2], ways[:, 0])
        assert np.allclose(np.diff(angles), turn, atol=1e-2)


def test_what_does_not_loop_stays_as_it_is() -> None:
    clip = read_deepmimic(_clip(loop="none"), "kick")
    assert unrolled(clip, 60.0) is clip


def test_written_as_bvh() -> None:
    clip = read_deepmimic(_clip(), "walk")
    skeleton, motion = motion_of_deepmimic(clip)
    other, again, notes = motion_of(read_bvh(bvh_of_deepmimic(clip), "walk.bvh"))
    assert notes == [] and other.unit_m == 0.01 and other.names == skeleton.names
    assert np.allclose(positions_of(other, again), positions_of(skeleton, motion), atol=1e-4)


@pytest.mark.parametrize(
    "data",
    [b"", b"{}", b"[]", b'{"Frames": []}', b'{"Frames": [[1, 2], [3]]}', b"[" * 5000, b'{"Frames": "x"}', b"\xff"],
)
def test_what_is_no_clip_is_refused(data: bytes) -> None:
    with pytest.raises(InputError, match=r"walk\.txt"):
        read_deepmimic(data, "walk.txt")


def test_bad_numbers_are_refused() -> None:
    for column, value in ((0, 0.0), (2, float("nan")), (4, 0.0)):
        raw = json.loads(_clip())
        raw["Frames"][1][column] = value
        raw["Frames"][1][4:8] = [0, 0, 0, 0] if column == 4 else raw["Frames"][1][4:8]
        with pytest.raises(InputError):
            read_deepmimic(json.dumps(raw).encode(), "a")


def test_embedded_clips_are_whole_small_and_split() -> None:
    splits = json.loads((CLIPS / "splits.json").read_text())["clips"]
    paths = sorted(CLIPS.glob("*.bvh"))
    names = {path.name for path in paths}
    assert len(paths) == 15 and sum(path.stat().st_size for path in paths) < 1_000_000
    assert set(splits["test"]) | set(splits["val"]) <= names and not set(splits["test"]) & set(splits["val"])
    assert "zlib" in splits["licence"]
    for path in paths:
        skeleton, motion, notes = motion_of(read_bvh(path.read_bytes(), path.name), trim_first="auto")
        assert notes == [] and motion.fps == 30 and motion.frames >= 46
        assert skeleton.sampled.all() and skeleton.unit_m == 0.01 and skeleton.up_axis == "y"
