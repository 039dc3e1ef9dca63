"""Clips of one motion artefact on the rigs of another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.motion import MotionReader, MotionWriter
from stages.data.rerig.config import Config
from stages.data.rerig.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.rig_changes import Rigged, with_other_proportions

CLIPS = Path(__file__).parents[3] / "stages" / "shared" / "clips"


def _clip(name: str) -> Rigged:
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / f"{name}.bvh").read_bytes(), name))
    return Rigged(skeleton, motion)


def _artefact(path: Path, clips: dict[str, tuple[Rigged, str]]) -> Path:
    with write_artefact(path, "motion", stage="ingest", config={}) as draft, MotionWriter(draft.folder) as writer:
        draft.licences.add("zlib")
        for name, (each, split) in clips.items():
            skeleton = writer.add_skeleton(each.skeleton)
            frames, fps = each.motion.frames, each.motion.fps
            row = ClipRow(
                name, f"a.zip!{name}", "0" * 64, skeleton, frames, fps, frames / fps, split, "zlib", "trimmed"
            )
            writer.add_clip(row, each.motion)
    return path


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips")
    return _artefact(folder / "motion", {"walk": (_clip("walk"), "test"), "run": (_clip("run"), "train")})


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rigs of other proportions than the clips'."""
    folder = tmp_path_factory.mktemp("rigs")
    made = [with_other_proportions(_clip("jump"), np.random.default_rng(seed)) for seed in (3, 4)]
    return _artefact(folder / "motion", {"a": (made[0], "train"), "b": (made[1], "train")})


def test_the_wanted_clips_move_on_the_other_rigs(motions: Path, rigs: Path, tmp_path: Path) -> None:
    report = run(Config(motion=motions, rigs=rigs, output=tmp_path / "moved"))
    assert report.figures == {"clips": 1, "asked": 1, "rigs": 2}
    with MotionReader(tmp_path / "moved") as reader, MotionReader(rigs) as lender, MotionReader(motions) as own:
        (row,) = reader.clips
        assert row.clip == f"walk@{row.skeleton}" and row.source == "a.zip!walk" and row.split == "test"
        assert row.flags == ""
        assert row.skeleton in {each.skeleton for each in lender.clips}
        moved, true = reader.motion(row.clip), own.motion("walk")
        assert moved.frames == true.frames == row.frames and moved.fps == true.fps
        np.testing.assert_array_equal(reader.skeleton(row.skeleton).offsets, lender.skeleton(row.skeleton).offsets)
        # It goes as far as it did, by the size of its legs.
        ways = [np.linalg.norm(each.root_positions[-1] - each.root_positions[0]) for each in (moved, true)]
        assert ways[0] == pytest.approx(ways[1], rel=0.3)
    manifest = open_artefact(tmp_path / "moved").manifest
    assert list(manifest.licences) == ["zlib"]


def test_the_same_clips_come_out_again(motions: Path, rigs: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        run(Config(motion=motions, rigs=rigs, output=tmp_path / name, splits=("train", "test")))
    one, two = (open_artefact(tmp_path / name).manifest.digest for name in ("one", "two"))
    assert one == two
    with MotionReader(tmp_path / "one") as reader:
        assert len(reader.clips) == 2


def test_a_split_without_clips_is_said(motions: Path, rigs: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="val"):
        run(Config(motion=motions, rigs=rigs, output=tmp_path / "moved", splits=("val",)))
    assert not (tmp_path / "moved").exists()
