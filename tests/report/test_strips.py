"""The picture of poses over time: what it shows, and that it shows it where it is."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from data_schemas.errors import UsageError
from stages.report.config import Config
from stages.report.run import run
from stages.report.side_views import shown_gap
from stages.report.strips import KEY_COLOUR, POSES, TRUTH_COLOUR, strips_svg
from tests.report.pages import bvh_text, parsed


def packed(name: str, points: np.ndarray) -> dict:
    scale = float(np.abs(points).max()) / 32767
    data = base64.b64encode(np.round(points / scale).astype("<i2").tobytes()).decode()
    edges = [[0, 1, 0, 0, 0], [1, 2, 0, 0, 1], [0, 3, 3, 1, 0]]  # a bone, the head's, a finger
    return {
        "name": name, "fps": 30.0, "frames": len(points), "nodes": 4, "root": 0, "edges": edges, "scale": scale,
        "points": data,
    }  # fmt: skip


def scene(offset: float = 0.1) -> dict:
    """A pole that walks along z, and one that stands `offset` metres ahead of it between the keys."""
    truth = np.zeros((31, 4, 3))
    truth[:, :, 1] = [0.9, 1.5, 1.8, 0.0]
    truth[:, :, 2] = np.linspace(0, 2, 31)[:, None]
    truth[:, 3, 2] += 0.3 * np.sin(np.arange(31))
    made = truth.copy()
    made[1:-1, :, 2] += offset
    return {
        "title": "pole",
        "detail": "<odd>",
        "keys": [0, 30],
        "floor": 0.0,
        "motions": [packed("truth", truth), packed("it", made)],
    }


def test_the_gap_is_the_one_in_which_the_truth_travels_most() -> None:
    points = np.zeros((21, 2, 3))
    points[11:16, :, 0] = np.arange(5)[:, None]
    points[16:, :, 0] = 4
    assert shown_gap(points, [0, 5, 10, 15, 20]) == (10, 15)
    assert shown_gap(points, [*range(8), *range(12, 21)]) == (7, 12)  # a transition: the frames that are missing
    assert shown_gap(points, list(range(21))) == (0, 20)


def test_a_strip_shows_every_pose_on_the_truth_and_says_how_far_it_is() -> None:
    svg = strips_svg([scene()])
    root = ElementTree.fromstring(svg)
    groups = [each for each in root.iter() if each.tag.endswith("}g")]
    colours = [each.attrib["stroke"] for each in groups]
    assert colours.count(TRUTH_COLOUR) == POSES and colours.count(KEY_COLOUR) == 2 and len(groups) == 2 * POSES
    texts = "".join(root.itertext())
    assert "it: 100 mm from truth" in texts and "<odd>" in texts and "frames 0 to 30" in texts


def test_a_drift_is_drawn_beside_the_truth_and_keys_on_it() -> None:
    root = ElementTree.fromstring(strips_svg([scene()]))
    paths = [each.find("{*}path").attrib["d"] for each in root.iter() if each.tag.endswith("}g")]
    bones = np.array([re.findall(r"[ML]([-\d.]+) ([-\d.]+)", path) for path in paths], float)  # (poses, 2 ends, 2)
    a_metre = (bones[0, 0, 1] - bones[0, 1, 1]) / 0.6
    apart = np.abs(bones[0::2, 0, 0] - bones[1::2, 0, 0])
    assert apart[[0, -1]] == pytest.approx(0, abs=0.11)
    assert apart[1:-1] == pytest.approx(0.1 * a_metre, abs=0.3) and a_metre > 20
    assert all(path.count("M") == 1 for path in paths)  # the finger and the head's bone are not lines


def test_the_stage_writes_the_scenes_named_and_their_own_keys(tmp_path: Path) -> None:
    (tmp_path / "walk.bvh").write_text(bvh_text())
    motions = tuple(f"{name}/{part}={tmp_path / 'walk.bvh'}" for name in ("one", "two") for part in ("truth", "it"))
    config = Config(
        motions=motions, scene_keyframes=("two=0:10,30:",), output=tmp_path / "r.html", licences=("CC <X>",),
        picture=tmp_path / "deep" / "p.svg", pictured=("two",),
    )  # fmt: skip
    report = run(config)
    _, scenes, page = parsed(config.output)
    assert scenes[0]["keys"] == [0, 15, 30, 40] and scenes[1]["keys"] == [*range(10), *range(30, 41)]
    texts = "".join(ElementTree.parse(tmp_path / "deep" / "p.svg").getroot().itertext())
    assert "two" in texts and "one" not in texts and "frames 9 to 30" in texts and "it: 0 mm" in texts
    assert "CC &lt;X&gt;" in page and report.lines[-1].startswith("Picture: ")
    for wrong in ({"pictured": ("three",)}, {"scene_keyframes": ("three=every:5",)}, {"scene_keyframes": ("two",)}):
        with pytest.raises(UsageError, match=r"three|SCENE=FRAMES"):
            run(config.model_copy(update={**wrong, "overwrite": True}))
