"""The moving picture of scenes: every frame of every motion, keys alone in their column, and a still pose."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from data_schemas.errors import UsageError
from stages.report.animation import SHARPNESS, animation_svg
from stages.report.config import Config
from stages.report.run import run
from tests.report.pages import bvh_text
from tests.report.test_strips import packed, scene


def outlines(svg: str) -> list[list[np.ndarray]]:
    """Of each path that plays, in the picture's order: the bones of each frame, (bones, 4) x, y, across, up."""
    played = []
    for each in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}animate"):
        if each.attrib["attributeName"] == "d":
            frames = [
                re.findall(r"M(-?\d+) (-?\d+)l(-?\d+) (-?\d+)", text) for text in each.attrib["values"].split(";")
            ]
            if frames[0]:
                played.append([np.array(bones, int) for bones in frames])
    return played


def test_every_frame_of_every_motion_is_drawn_where_it_is() -> None:
    keys, truth, made = outlines(animation_svg([scene(offset=0.1)]))
    assert len(keys) == 2 and len(truth) == len(made) == 31
    a_metre = -truth[0][0, 3] / 0.6
    assert a_metre > 20 * SHARPNESS
    apart = np.array([abs(m[0, 0] - t[0, 0]) for m, t in zip(made, truth, strict=True)])
    assert apart[[0, -1]] == pytest.approx(0, abs=1) and apart[1:-1] == pytest.approx(0.1 * a_metre, abs=2)


def test_the_first_column_shows_keys_alone_each_until_the_next() -> None:
    pole = scene()
    pole["keys"] = [0, 10, 30]
    keys, truth, _ = outlines(animation_svg([pole]))
    for shown, key in zip(keys, pole["keys"], strict=True):
        np.testing.assert_array_equal(shown, truth[key])
    (times,) = {each for each in re.findall(r'calcMode="discrete" keyTimes="([^"]*)"', animation_svg([pole]))}
    assert [float(each) for each in times.split(";")] == pytest.approx([0, 10 / 31, 30 / 31], abs=1e-4)


def test_a_row_lasts_as_long_as_its_motion_and_other_rates_keep_its_time() -> None:
    double = scene()
    points = np.zeros((61, 4, 3))
    points[:, :, 1] = [0.9, 1.5, 1.8, 0.0]
    points[:, :, 2] = np.linspace(0, 2, 61)[:, None]
    double["motions"][1] = packed("it", points) | {"fps": 60.0}
    svg = animation_svg([double])
    assert set(re.findall(r'dur="([\d.]+)s"', svg)) == {f"{31 / 30:.3f}"}
    _, truth, made = outlines(svg)
    assert [abs(m - t).max() for m, t in zip(made, truth, strict=True)] == pytest.approx([0] * 31, abs=1)


def test_readers_who_asked_for_less_motion_see_a_pose_between_two_keys() -> None:
    svg = animation_svg([scene()])
    assert "@media (prefers-reduced-motion:reduce){.moving{display:none}.still{display:inline}}" in svg
    root = ElementTree.fromstring(svg)
    groups = [each for each in root.iter("{http://www.w3.org/2000/svg}g") if each.attrib.get("class") == "still"]
    assert len(groups) == 3 and not [each for group in groups for each in group.iter() if "animate" in each.tag]
    _, truth, made = outlines(svg)
    for group, frames in zip(groups[1:], (truth, made), strict=True):
        bone = re.findall(r"M(-?\d+) (-?\d+)l(-?\d+) (-?\d+)", group[0].attrib["d"])
        np.testing.assert_array_equal(np.array(bone, int), frames[15])
    moving = {"{http://www.w3.org/2000/svg}path", "{http://www.w3.org/2000/svg}circle"}
    loose = [each for each in root if each.tag in moving and len(each) and each.attrib.get("class") != "moving"]
    assert not loose


def test_the_truth_of_a_row_is_written_once_and_stands_in_every_cell() -> None:
    three = scene()
    three["motions"].append(three["motions"][1] | {"name": "another"})
    root = ElementTree.fromstring(svg := animation_svg([three, scene(), three]))
    assert len(outlines(svg)) == 4 + 3 + 4  # keys, the truth and the others of each row
    svg_name = "{http://www.w3.org/2000/svg}"
    cells = [each for each in root.iter(f"{svg_name}g") if each.get("transform") and not each.find(f"{svg_name}g/g")]
    truths = [cell[0].get("id") or cell[0].get("href") for cell in cells if cell[0].get("class") != "moving"]
    assert truths == ["truth-0", "#truth-0", "truth-1", "truth-2", "#truth-2"]


def test_the_note_says_how_far_the_missing_frames_are_from_the_truth() -> None:
    texts = "".join(ElementTree.fromstring(animation_svg([scene(offset=0.25)])).itertext())
    assert "it: 250 mm from truth" in texts and "<odd>" in texts and "2 of 31 frames" in texts


def test_the_stage_writes_the_scenes_asked_for(tmp_path: Path) -> None:
    (tmp_path / "walk.bvh").write_text(bvh_text())
    motions = tuple(
        f"{name}/{part}={tmp_path / 'walk.bvh'}" for name in ("jump", "waltz") for part in ("truth", "it")
    )
    config = Config(
        motions=motions, output=tmp_path / "r.html", animation=tmp_path / "deep" / "a.svg", pictured=("waltz",)
    )
    assert run(config).lines[-1].startswith("Animation: ")
    texts = "".join(ElementTree.parse(tmp_path / "deep" / "a.svg").getroot().itertext())
    assert "waltz" in texts and "jump" not in texts and "slerp" in texts and "it: 0 mm" in texts
    wrong = config.model_copy(update={"pictured": ("three",), "animation": tmp_path / "b.svg", "overwrite": True})
    with pytest.raises(UsageError, match="three"):
        run(wrong)
    assert not (tmp_path / "b.svg").exists()
