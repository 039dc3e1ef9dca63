"""Training clips on other rigs of the collection: the same motion, only of training, only on rigs of training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.motion import MotionWriter
from data_schemas.tpc import TpcReader
from stages.sample_tpc.config import Config
from stages.sample_tpc.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.rig_changes import Rigged, with_other_proportions

CLIPS = Path(__file__).parents[2] / "stages" / "shared" / "clips"


def _row(clip: str, skeleton: str, motion, split: str) -> ClipRow:
    seconds = motion.frames / motion.fps
    return ClipRow(clip, f"a.zip!{clip}", "0" * 64, skeleton, motion.frames, motion.fps, seconds, split, "zlib")


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk and a run on two rigs of other proportions, and a test clip on a third rig."""
    path = tmp_path_factory.mktemp("rigs") / "motion"
    kept = []
    for name in ("walk", "run"):
        skeleton, motion, _ = motion_of(read_bvh((CLIPS / f"{name}.bvh").read_bytes(), name))
        kept.append(Rigged(skeleton, motion))
    kept[1] = with_other_proportions(kept[1], np.random.default_rng(1))
    third = with_other_proportions(kept[0], np.random.default_rng(8))
    with write_artefact(path, "motion", stage="ingest", config={}) as draft, MotionWriter(draft.folder) as writer:
        for name, each, split in (("walk", kept[0], "train"), ("run", kept[1], "train"), ("last", third, "test")):
            skeleton = writer.add_skeleton(each.skeleton)
            writer.add_clip(_row(name, skeleton, each.motion, split), each.motion)
    return path


def _turned(rotations: np.ndarray) -> Rotation:
    first = np.repeat(rotations[:1], len(rotations), 0).reshape(-1, 4)
    return Rotation.from_quat(rotations.reshape(-1, 4)) * Rotation.from_quat(first).inv()


def test_a_motion_on_another_rig_turns_alike_and_keeps_its_split(motions: Path, tmp_path: Path) -> None:
    report = run(Config(motion=motions, output=tmp_path / "tpc", mixed_rigs=1.0, pack=True))
    assert report.figures["on_other_rigs"] == 2
    with TpcReader(tmp_path / "tpc") as reader:
        rows = {row.clip: row for row in reader.clips}
        added = [row for row in rows.values() if "@" in row.clip]
        assert {row.clip.split("@")[0] for row in added} == {"walk", "run"}
        held_out = rows["last"].skeleton
        for row in added:
            own = rows[row.clip.split("@")[0]]
            assert row.split == "train" and row.source == own.source and row.frames == own.frames
            assert row.skeleton not in (own.skeleton, held_out)
            # Since its first frame every bone has turned, in the world, as the source's has.
            made, true = (_turned(reader.transforms(clip)[1]) for clip in (row.clip, own.clip))
            apart = (made * true.inv()).magnitude()
            assert np.degrees(apart).mean() < 3 and np.degrees(true.magnitude()).mean() > 10


def test_a_share_of_the_clips_whatever_their_order(motions: Path, tmp_path: Path) -> None:
    run(Config(motion=motions, output=tmp_path / "none"))
    with TpcReader(tmp_path / "none") as reader:
        assert len(reader.clips) == 3
    some = Config(motion=motions, output=tmp_path / "some", mixed_rigs=0.5, seed=3)
    run(some)
    run(replace_output(some, tmp_path / "again"))
    names = [tuple(row.clip for row in TpcReader(tmp_path / name).clips) for name in ("some", "again")]
    assert names[0] == names[1]


def replace_output(config: Config, output: Path) -> Config:
    return config.model_copy(update={"output": output})


def test_positions_are_neither_packed_nor_carried_over(motions: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--bake"):
        Config(motion=motions, output=tmp_path / "x", bake=True, pack=True)
