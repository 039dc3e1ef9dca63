"""Parts of a collection, made apart and merged, are the whole; what does not belong together is refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact, verify
from data_schemas.errors import InputError, UsageError
from data_schemas.merging import merge_artefacts
from data_schemas.motion import MotionReader
from data_schemas.source_table import read_sources
from data_schemas.tpc import TpcReader
from stages.ingest import run as ingest
from stages.ingest.config import Config as Ingest
from stages.sample_tpc.config import Config as SampleTpc
from stages.sample_tpc.run import run as sample_tpc

CLIPS = Path(ingest.__file__).parents[1] / "shared" / "clips"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("walk", "kick", "jump", "run", "punch"):
        shutil.copy(CLIPS / f"{name}.bvh", folder)
    (folder / "bad.bvh").write_text("HIERARCHY\nnothing")
    return folder


def _ingest(recordings: Path, output: Path, **more: str) -> Path:
    ingest.run(Ingest.model_validate({"sources": (str(recordings),), "output": output, "workers": 1} | more))
    return output


def test_parts_of_an_ingest_make_the_whole(recordings: Path, tmp_path: Path):
    whole = _ingest(recordings, tmp_path / "whole")
    parts = [_ingest(recordings, tmp_path / f"part-{i}", shard=f"{i}/3") for i in (1, 2, 3)]
    rows = merge_artefacts(parts, tmp_path / "merged")
    assert verify(tmp_path / "merged") == []
    with MotionReader(whole) as one, MotionReader(tmp_path / "merged") as other:
        assert other.clips == rows == tuple(sorted(one.clips, key=lambda row: (row.source, row.clip)))
        assert other.skeletons() == one.skeletons()
        for row in one.clips:
            for a, b in zip(vars(one.motion(row.clip)).values(), vars(other.motion(row.clip)).values(), strict=True):
                np.testing.assert_array_equal(a, b)
        assert sorted(read_sources(one.folder), key=lambda row: row.source) == list(read_sources(other.folder))
    assert set(open_artefact(tmp_path / "merged").manifest.licences) == set(open_artefact(whole).manifest.licences)


def test_parts_of_clouds_make_the_whole(recordings: Path, tmp_path: Path):
    motion = _ingest(recordings, tmp_path / "motion")
    outputs = [tmp_path / "whole", tmp_path / "first", tmp_path / "second"]
    for output, shard in zip(outputs, (None, "1/2", "2/2"), strict=True):
        sample_tpc(SampleTpc(motion=motion, output=output, shard=shard, points=16))
    merge_artefacts(outputs[1:], tmp_path / "merged")
    with TpcReader(outputs[0]) as one, TpcReader(tmp_path / "merged") as other:
        assert {row.clip for row in one.clips} == {row.clip for row in other.clips}
        for row in one.clips:
            np.testing.assert_array_equal(one.points(row.clip)[0], other.points(row.clip)[0])


def test_a_source_that_is_in_two_parts_is_refused(recordings: Path, tmp_path: Path):
    part = _ingest(recordings, tmp_path / "part", shard="1/2")
    with pytest.raises(InputError, match="is in"):
        merge_artefacts([part, part], tmp_path / "merged")
    assert not (tmp_path / "merged" / "manifest.json").exists()


def test_clips_of_one_name_from_other_folders_are_both_kept(recordings: Path, tmp_path: Path):
    parts = []
    for place in ("here", "there"):
        (tmp_path / place / "takes").mkdir(parents=True)
        shutil.copy(recordings / ("walk.bvh" if place == "here" else "run.bvh"), tmp_path / place / "takes" / "a.bvh")
        parts.append(_ingest(tmp_path / place / "takes", tmp_path / f"part-{place}"))
    rows = merge_artefacts(parts, tmp_path / "merged")
    assert len({row.clip for row in rows}) == 2


def test_clouds_drawn_with_other_seeds_are_refused(recordings: Path, tmp_path: Path):
    motion = _ingest(recordings, tmp_path / "motion")
    for i in (1, 2):
        sample_tpc(SampleTpc(motion=motion, output=tmp_path / f"{i}", shard=f"{i}/2", points=16, seed=i))
    with pytest.raises(InputError, match="same settings and seed"):
        merge_artefacts([tmp_path / "1", tmp_path / "2"], tmp_path / "merged")
    with pytest.raises(UsageError, match="cannot be merged"):
        merge_artefacts([motion, tmp_path / "1"], tmp_path / "merged")


@pytest.mark.parametrize("shard", ["0/2", "3/2", "1", "a/b", "1/0", "-1/2", "1/2/3", ""])
def test_parts_that_cannot_be_are_refused(recordings: Path, tmp_path: Path, shard: str):
    with pytest.raises(UsageError, match="--shard"):
        _ingest(recordings, tmp_path / "part", shard=shard)


def test_where_chooses_clips(recordings: Path, tmp_path: Path):
    motion = _ingest(recordings, tmp_path / "motion")
    report = sample_tpc(
        SampleTpc(motion=motion, output=tmp_path / "tpc", points=16, where='clip != "none" and fps < 31')
    )
    assert report.figures["clips"] == 5
    with pytest.raises(UsageError, match="No clip"):
        sample_tpc(SampleTpc(motion=motion, output=tmp_path / "tpc", where="fps > 1000", overwrite=True))
