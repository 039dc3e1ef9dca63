"""The gallery: clips that weights were not trained on, six rigs, and the page and picture of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.kinematics.forward import positions_of
from tests.pipeline.benchmark_scripts import benchmark_script
from tests.report.pages import parsed
from tests.shared.inference.examples import write_random_weights

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data"


@pytest.fixture(scope="module")
def made() -> ModuleType:
    return benchmark_script("gallery")


def test_it_has_twelve_clips_two_on_each_of_six_rigs(made: ModuleType) -> None:
    rigs = [each.rig for each in made.CLIPS]
    assert len(rigs) == len({each.name + each.rig for each in made.CLIPS}) == 12
    assert {rig: rigs.count(rig) for rig in rigs} == dict.fromkeys(rigs, 2) and len(set(rigs)) == 6
    assert {each.words for each in made.CLIPS} == {
        "a key every 15 frames",
        "a key every 30 frames",
        "30 frames missing",
    }


@pytest.mark.real
@pytest.mark.skipif(not (SHARED / "splits.json").is_file(), reason="no real motion capture here")
def test_its_clips_are_of_the_test_split(made: ModuleType) -> None:
    splits = json.loads((SHARED / "splits.json").read_text())
    for each in made.CLIPS:
        archive, mark, member = each.place.partition("!")
        if mark:
            assert member in splits[archive]["test"]


def test_absent_archives_are_told_in_one_sentence(made: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"needs bandai-namco-1.zip, .* SHARED_DATA="):
        made.gallery(made.CLIPS, tmp_path, tmp_path / "out", "small-free")
    assert not (tmp_path / "out").exists()


def test_keys_of_a_gap_leave_its_frames_out(made: ModuleType) -> None:
    shown = made.Shown("rig", "name", "place", missing=30)
    assert shown.keys(121) == "0:45,75:" and shown.keys(74) == "0:22,52:"


def test_the_page_plays_truth_slerp_and_weights_on_the_clips_own_keys(made: ModuleType, tmp_path: Path) -> None:
    weights = write_random_weights(tmp_path / "mine")
    clips = tuple(each for each in made.CLIPS if each.rig == "embedded")
    clips = (*clips, replace(clips[0], rig="changed rig", changed=True))
    lines = made.gallery(clips, tmp_path, tmp_path / "out", str(weights), tmp_path / "p.svg")
    _, scenes, page = parsed(tmp_path / "out" / "gallery.html")
    assert [[m["name"] for m in scene["motions"]] for scene in scenes] == [["truth", "slerp", "mine"]] * 3
    assert [scene["name"].split(":")[0] for scene in scenes] == [
        "dance, embedded",
        "getting up, embedded",
        "dance, changed rig",
    ]
    assert scenes[0]["keys"][:3] == [0, 15, 30] and scenes[1]["keys"] == [*range(30), *range(60, 91)]
    assert scenes[2]["motions"][0]["nodes"] > scenes[0]["motions"][0]["nodes"] + 10
    assert "zlib" in page and len(lines) == 5
    texts = "".join(ElementTree.parse(tmp_path / "p.svg").getroot().itertext())
    assert "dance, embedded" in texts and "dance, changed rig" in texts and "getting up" not in texts


def test_the_changed_rig_stands_where_the_clip_does(made: ModuleType) -> None:
    skeleton, motion = made.four_seconds(made.Shown("embedded", "dance", "dance_b"), ROOT)
    changed, moved = made.on_changed_rig(skeleton, motion)
    read, again, _ = motion_of(read_bvh(bvh_of_motion(changed, moved, "x"), "x"))
    places, true = positions_of(read, again), positions_of(skeleton, motion)
    at = [read.names.index(name) for name in skeleton.names]
    root = skeleton.root
    np.testing.assert_allclose(places[:, at[root]], true[:, root], atol=1e-3)
    np.testing.assert_allclose(places[:, at], true, atol=0.05)  # a spine of twice the joints bends a little otherwise
    assert set(read.names) > set(skeleton.names)
    assert [read.groups[j] for j in at] == list(skeleton.groups)
