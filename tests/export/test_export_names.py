"""Clips' names that try to lead out of the output folder, for every command that writes a file for each clip."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from data_schemas.errors import UsageError
from stages.data.pick.config import Config as PickConfig
from stages.data.pick.run import run as pick
from stages.export.config import Config
from stages.export.run import run
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.gltf_write import glb_of_motion
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.glb_bytes import glb_with, parts_of_glb

NAMES = ("/../../out", "../out", "..\\out", "a/b", "a:b", "a_b", "A_B", "con", ".hidden", "x" * 300, "ok")


def glb_of_clips(names: tuple[str, ...]) -> bytes:
    """A GLB whose one animation is there under each of the names."""
    skeleton, motion, _ = motion_of(read_bvh(BvhText(frames=8).data(), "walk.bvh"))
    text, rest = parts_of_glb(glb_of_motion(skeleton, motion, "walk"))
    document = json.loads(text)
    document["animations"] = [{**document["animations"][0], "name": name} for name in names]
    return glb_with(json.dumps(document).encode(), rest)


@pytest.mark.parametrize("suffix", ["bvh", "glb", "csv", "parquet", "amass"])
def test_an_export_stays_in_its_folder(tmp_path: Path, suffix: str) -> None:
    source = tmp_path / "clips.glb"
    source.write_bytes(glb_of_clips(NAMES))
    folder = tmp_path / "deep" / "down" / "out"
    report = run(Config(input=str(source), output=folder, format=suffix))  # type: ignore[arg-type]
    everything = {path for path in tmp_path.rglob("*") if path.is_file()} - {source}
    assert {path.parent for path in everything} == {folder}
    assert len(everything) == len(NAMES) == len(report.figures["files"])
    assert len({path.name.casefold() for path in everything}) == len(NAMES)
    assert any("Its file is clips." in line for line in report.lines)
    with pytest.raises(UsageError, match="exists"):
        run(Config(input=str(source), output=folder, format=suffix))  # type: ignore[arg-type]


def test_clips_of_an_artefact_stay_in_the_folder_too(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for name in ("..\\out", "con", "C:x"):
        (tmp_path / "in" / f"{name}.bvh").write_bytes(BvhText(frames=8).data())
    ingest(IngestConfig(sources=(str(tmp_path / "in"),), output=tmp_path / "motion", licence="CC0", workers=1))
    export = run(Config(input=str(tmp_path / "motion"), output=tmp_path / "exported", format="csv"))
    picked = pick(PickConfig(motion=tmp_path / "motion", output=tmp_path / "picked", splits=("train", "val", "test")))
    assert len(export.figures["files"]) == 3 and len(picked.figures["clips"]) == 3
    made = [*(tmp_path / "exported").iterdir(), *(tmp_path / "picked").glob("*.bvh")]
    assert len(made) == 6
    for path in made:
        assert not set(path.name) & set("\\:") and not path.name.lower().startswith("con.")


def test_a_pick_does_not_replace_a_source(tmp_path: Path) -> None:
    sources = tmp_path / "in"
    sources.mkdir()
    for name in ("walk.bvh", "in.walk.bvh"):  # the clip of the first is called in.walk
        (sources / name).write_bytes(BvhText(frames=90).data())
    ingest(IngestConfig(sources=(str(sources),), output=tmp_path / "motion", licence="CC0", workers=1))
    splits = ("train", "val", "test")
    with pytest.raises(UsageError, match="given as a source too"):
        pick(PickConfig(motion=tmp_path / "motion", output=sources, splits=splits, overwrite=True))
