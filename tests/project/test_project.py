"""`pumps project`: the keypoints are those of the camera that it states, in the layout that was asked for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from stages.project.config import Config
from stages.project.run import run
from stages.shared.formats.keypoint_files import read_keypoints
from stages.shared.formats.keypoint_layouts import LAYOUTS, landmark_columns
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import source_named
from stages.shared.humanoid.landmarks import landmarks_of
from stages.shared.kinematics.cameras import Intrinsics, in_camera, projected
from stages.shared.kinematics.forward_numpy import positions_of
from tests.docs.pages import ROOT

_KICK = ROOT / "stages" / "shared" / "clips" / "kick.bvh"


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_stated_camera_sees_the_keypoints(layout: str, tmp_path: Path):
    output = tmp_path / "a.json"
    report = run(Config(input=_KICK, output=output, layout=layout, seed=3))
    found = read_keypoints(str(output))
    assert found.layout == layout and found.size == (1920, 1080) and found.fps == pytest.approx(30, rel=1e-3)
    recording = recordings_in(source_named(str(_KICK)), Asked())[0]
    heads, turns = positions_of(recording.skeleton, recording.motion), recording.motion.rotations.astype(float)
    marks = landmarks_of(recording.skeleton, heads, turns).place(heads, turns)
    camera = report.figures["camera"]
    rotation = np.broadcast_to(camera["rotation_xyzw"], (*marks.shape[:2], 4))
    rays = projected(in_camera(marks, np.array(camera["position_m"]), rotation))
    pixels = Intrinsics(camera["focal_px"], tuple(camera["centre_px"])).pixels(rays)
    columns, chosen = landmark_columns(layout)
    np.testing.assert_allclose(found.places[:, columns], pixels[:, chosen], atol=2e-3)
    assert json.loads(output.read_text())["meta_info"]["camera"] == camera


def test_errors_are_drawn_from_the_seed(tmp_path: Path):
    paths = [tmp_path / f"{seed}.json" for seed in (0, 1)]
    for seed, path in enumerate(paths):
        run(Config(input=_KICK, output=path, errors="detector", azimuth=0, elevation=0, distance=5, seed=seed))
    one, other = (read_keypoints(str(path)) for path in paths)
    assert not np.array_equal(one.places, other.places, equal_nan=True)
    assert (one.confidences < 1).any()


def test_bad_input(tmp_path: Path):
    with pytest.raises(InputError, match="no keypoint layout"):
        run(Config(input=_KICK, output=tmp_path / "a.json", layout="coco18"))
    with pytest.raises(UsageError, match="behind the camera"):
        run(Config(input=_KICK, output=tmp_path / "a.json", distance=0.21))
    with pytest.raises(UsageError, match="size of an image"):
        run(Config(input=_KICK, output=tmp_path / "a.json", image_size="big"))
