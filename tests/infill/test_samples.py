"""`pumps infill --samples`: the usual fill first, then others with the same keys."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

import pumps
from data_schemas.errors import InputError, UsageError
from stages.infill.config import Config
from stages.infill.run import run
from stages.shared.kinematics.foot_contacts import LEGS
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.weights.shipped import SHIPPED, VARIATION_NAME

CLIP = Path("stages/shared/clips/jump.bvh")
KEYS = (0, 15, 40)


def rows_of(path: Path) -> list[str]:
    lines = path.read_text().splitlines()
    return lines[next(n for n, line in enumerate(lines) if line.startswith("Frame Time")) + 1 :]


def test_every_sample_keeps_the_keys_and_the_first_is_the_usual_fill(tmp_path: Path):
    settings = {"input": CLIP, "keyframes": ",".join(map(str, KEYS)), "device": "cpu"}
    run(Config(**settings, output=tmp_path / "usual.bvh"))
    report = run(Config(**settings, output=tmp_path / "tries.bvh", samples=3))
    tries = [tmp_path / f"tries-{number}.bvh" for number in (1, 2, 3)]
    assert sorted(path.name for path in tmp_path.iterdir()) == [*(path.name for path in tries), "usual.bvh"]
    assert tries[0].read_bytes() == (tmp_path / "usual.bvh").read_bytes()
    source, rows = rows_of(CLIP), [rows_of(path) for path in tries]
    for own in rows:
        assert len(own) == len(source)
        assert [own[key] for key in (*KEYS, *range(41, len(own)))] == [
            source[key] for key in (*KEYS, *range(41, len(own)))
        ]
    between = [frame for frame in range(40) if frame not in KEYS]
    assert all(rows[a][frame] != rows[b][frame] for a, b in ((0, 1), (0, 2), (1, 2)) for frame in between)
    for number, whole in enumerate(tries, 1):
        alone = tmp_path / "alone" / f"{number}.bvh"
        report_alone = run(Config(**settings, output=alone, sample=number))
        assert alone.read_bytes() == whole.read_bytes() and report_alone.output == alone
    assert len(list((tmp_path / "alone").iterdir())) == 3
    assert report.output == tries[0] and report.figures["samples_apart_mm"] > 5
    again = pumps.infill_samples(pumps.load(CLIP), 2, list(KEYS), device="cpu")
    assert [each.source for each in again] == [path.read_bytes() for path in tries[:2]]
    other = pumps.infill_samples(pumps.load(CLIP), 2, list(KEYS), device="cpu", seed=1)
    assert np.abs(other[1].positions - again[1].positions).max() > 0.005


def test_kept_parts_stay_in_every_sample():
    walk = pumps.load("stages/shared/clips/walk.bvh")
    fills = pumps.infill_samples(walk, 2, "every:30", keep={"legs": "all"}, pins={"right_hand": "3-12"}, device="cpu")
    legs = np.isin(walk.skeleton.groups, LEGS)
    kept, usual, other = (
        SkeletonPose.of_motion(each.skeleton, each.record).local[:, legs] for each in (walk, *fills)
    )
    assert legs.any()
    for made in (usual, other):
        assert float(((made * kept).sum(-1).abs() - 1).abs().max()) < 1e-5
    assert np.abs(fills[0].positions - fills[1].positions).max() > 0.005


def test_weights_that_do_not_hold_variation_and_outputs_that_exist_are_refused(tmp_path: Path):
    settings = {"input": CLIP, "keyframes": "0,40", "samples": 2, "device": "cpu"}
    bare = tmp_path / "bare"
    shutil.copytree(SHIPPED / "small-free", bare, ignore=shutil.ignore_patterns(VARIATION_NAME))
    with pytest.raises(InputError, match="do not hold how motions vary"):
        run(Config(**settings, output=tmp_path / "tries.bvh", weights=str(bare)))
    assert [path.name for path in tmp_path.iterdir()] == ["bare"]
    (tmp_path / "tries-2.bvh").write_text("mine")
    with pytest.raises(UsageError, match="tries-2"):
        run(Config(**settings, output=tmp_path / "tries.bvh"))
    assert (tmp_path / "tries-2.bvh").read_text() == "mine"


def test_one_fill_and_several_are_not_asked_for_at_once(tmp_path: Path):
    settings = {"input": CLIP, "output": tmp_path / "a.bvh", "keyframes": "0,40"}
    for wrong in ({"sample": 2, "samples": 3}, {"sample": 0}):
        with pytest.raises(ValidationError, match="sample"):
            Config.model_validate({**settings, **wrong})
    assert Config(**settings, sample=4).outputs_of(tmp_path / "a.bvh") == (tmp_path / "a.bvh",)


def test_a_folder_gets_several_of_each_file_and_goes_on(tmp_path: Path):
    clips = tmp_path / "in"
    clips.mkdir()
    (clips / "jump.bvh").write_bytes(CLIP.read_bytes())
    settings = {"input": clips, "keyframes": "0,20,40", "samples": 2, "device": "cpu", "jobs": 1}
    run(Config(**settings, output=tmp_path / "out"))
    made = {path.name: path.read_bytes() for path in (tmp_path / "out").glob("*.bvh")}
    assert sorted(made) == ["jump-1.bvh", "jump-2.bvh"]
    assert run(Config(**settings, output=tmp_path / "out")).figures["kept"] == 1
    (tmp_path / "out/jump-2.bvh").unlink()
    assert run(Config(**settings, output=tmp_path / "out")).figures["kept"] == 0
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").glob("*.bvh")} == made


def test_samples_of_a_folder_may_have_the_names_of_its_files(tmp_path: Path):
    clips = tmp_path / "in"
    clips.mkdir()
    for name in ("jump.bvh", "jump-1.bvh"):  # the first one's samples are jump-1.bvh and jump-2.bvh
        (clips / name).write_bytes(CLIP.read_bytes())
    settings = {"input": clips, "keyframes": "0,40", "samples": 2, "device": "cpu", "jobs": 1}
    run(Config(**settings, output=tmp_path / "out"))
    made = {path.name: path.read_bytes() for path in (tmp_path / "out").glob("*.bvh")}
    assert sorted(made) == ["jump-1-1.bvh", "jump-1-2.bvh", "jump-1.bvh", "jump-2.bvh"]
    assert made["jump-1-2.bvh"] == made["jump-2.bvh"] and made["jump-1.bvh"] == made["jump-1-1.bvh"]
