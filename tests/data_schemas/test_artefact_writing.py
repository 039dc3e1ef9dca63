"""What a write leaves on the disk, and what it must never touch."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel

from data_schemas.artefact import open_artefact, partial_folder, verify, write_artefact
from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.kinds import KINDS
from data_schemas.version import PUMPS_VERSION
from tests.data_schemas.examples import write_motion, write_text_artefact


def test_manifest_says_how_it_was_made(tmp_path):
    artefact = write_motion(tmp_path / "m")
    manifest = artefact.manifest
    assert (manifest.kind, manifest.schema_version, manifest.stage) == (
        "motion",
        KINDS["motion"].schema_version,
        "ingest",
    )
    assert manifest.created_by == f"pumps {PUMPS_VERSION}"
    assert manifest.config == {"seed": 0}
    assert manifest.licences == ["zlib"]
    assert set(manifest.files) == {"motions.h5", "clips.parquet"}
    assert artefact.folder == tmp_path / "m" / manifest.data
    assert manifest.data == f"data-{manifest.digest[:16]}"
    assert verify(tmp_path / "m") == []
    assert open_artefact(tmp_path / "m" / "manifest.json").manifest == manifest


def test_only_manifest_and_one_data_folder_remain(tmp_path):
    for seed in range(3):
        artefact = write_motion(tmp_path / "m", seed=seed)
    assert {p.name for p in (tmp_path / "m").iterdir()} == {"manifest.json", artefact.manifest.data}


def test_same_content_has_the_same_digest_and_a_fresh_manifest(tmp_path):
    first = write_motion(tmp_path / "a")
    second = write_motion(tmp_path / "b", config={"other": 1})
    assert first.manifest.digest == second.manifest.digest
    assert first.manifest.digest != write_motion(tmp_path / "c", seed=1).manifest.digest

    os.utime(tmp_path / "a" / "manifest.json", (1, 1))
    write_motion(tmp_path / "a")
    assert (tmp_path / "a" / "manifest.json").stat().st_mtime > 1  # make looks at this time


def test_writing_again_mends_damaged_data_of_the_same_content(tmp_path):
    artefact = write_text_artefact(tmp_path / "a", "text")
    (artefact.folder / "summary.md").write_text("damaged")
    assert len(verify(tmp_path / "a")) == 1
    mended = write_text_artefact(tmp_path / "a", "text")
    assert verify(tmp_path / "a") == []
    assert mended.manifest.digest == artefact.manifest.digest
    assert mended.manifest.data == artefact.manifest.data + "-2"
    assert not artefact.folder.exists()
    assert write_text_artefact(tmp_path / "a", "text").manifest.digest == mended.manifest.digest
    assert verify(tmp_path / "a") == []


def test_an_exception_leaves_the_old_artefact_and_no_draft(tmp_path):
    old = write_text_artefact(tmp_path / "a", "old")
    with (
        pytest.raises(RuntimeError, match="midway"),
        write_artefact(tmp_path / "a", "metrics", stage="s", config={}) as draft,
    ):
        (draft.folder / "summary.md").write_text("new")
        raise RuntimeError("midway")
    assert open_artefact(tmp_path / "a").manifest == old.manifest
    assert verify(tmp_path / "a") == []
    assert {p.name for p in (tmp_path / "a").iterdir()} == {"manifest.json", old.manifest.data}


def test_a_failed_first_write_leaves_nothing(tmp_path):
    with (
        pytest.raises(PumpsError, match="wrote no file"),
        write_artefact(tmp_path / "a", "metrics", stage="s", config={}),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


def test_licences_flow_from_inputs(tmp_path):
    write_motion(tmp_path / "m", licences=["zlib", "CC BY-NC 4.0"])
    with write_artefact(tmp_path / "n", "metrics", stage="s", config={}, inputs=[tmp_path / "m"]) as draft:
        (draft.folder / "summary.md").write_text("x")
        draft.licences.add("own")
    assert open_artefact(tmp_path / "n").manifest.licences == ["CC BY-NC 4.0", "own", "zlib"]


def test_inputs_are_recorded_relative_with_their_digests(tmp_path):
    motion = write_motion(tmp_path / "run" / "m")
    source = tmp_path / "source.zip"
    source.write_bytes(b"abc")
    artefact = write_text_artefact(tmp_path / "run" / "n", "x", inputs=[motion, source])
    first, second = artefact.manifest.inputs
    assert (first.path, first.kind, first.digest) == ("../m", "motion", motion.manifest.digest)
    assert (second.path, second.kind) == ("../../source.zip", "file")
    with pytest.raises(InputError, match=r"nowhere\.zip does not exist"):
        write_text_artefact(tmp_path / "p", "x", inputs=[tmp_path / "nowhere.zip"])


class _Config(BaseModel):
    path: Path = Path("a/b")
    sizes: tuple[int, ...] = (1, 2)


def test_config_and_summary_become_plain_data(tmp_path):
    with write_artefact(tmp_path / "a", "metrics", stage="s", config=_Config()) as draft:
        (draft.folder / "summary.md").write_text("x")
        draft.summary.update(loss=float("nan"), counts=np.arange(3), one=np.float32(0.5))
        draft.summary.update(names={"b", "a"}, odd="\udc80")
    manifest = open_artefact(tmp_path / "a").manifest
    assert manifest.config == {"path": "a/b", "sizes": [1, 2]}
    assert manifest.summary == {"loss": None, "counts": [0, 1, 2], "one": 0.5, "names": ["a", "b"], "odd": "\udc80"}


def test_other_things_are_left_alone(tmp_path):
    write_motion(tmp_path / "m")
    with pytest.raises(UsageError, match="holds a 'motion' artefact"):
        write_text_artefact(tmp_path / "m", "x")

    (tmp_path / "web").mkdir()
    (tmp_path / "web" / "manifest.json").write_text(json.dumps({"name": "an app"}))
    with pytest.raises(UsageError, match="that pumps did not write"):
        write_text_artefact(tmp_path / "web", "x")
    assert json.loads((tmp_path / "web" / "manifest.json").read_text()) == {"name": "an app"}

    (tmp_path / "file").write_text("x")
    with pytest.raises(UsageError, match="is a file"):
        write_text_artefact(tmp_path / "file", "x")

    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "photo.jpg").write_text("mine")
    (tmp_path / "home" / "data-mine").mkdir()
    write_text_artefact(tmp_path / "home", "x")
    assert (tmp_path / "home" / "photo.jpg").read_text() == "mine"
    assert (tmp_path / "home" / "data-mine").is_dir()


def test_one_writer_at_a_time(tmp_path):
    with write_artefact(tmp_path / "a", "metrics", stage="s", config={}) as draft:
        (draft.folder / "summary.md").write_text("first")
        with pytest.raises(PumpsError, match="being written by another"):
            write_text_artefact(tmp_path / "a", "second")
    assert (open_artefact(tmp_path / "a").folder / "summary.md").read_text() == "first"
    write_text_artefact(tmp_path / "a", "second")


def test_links_and_odd_names_are_no_part_of_an_artefact(tmp_path):
    for name in ("link", "a b", "-x"):
        with (
            pytest.raises(PumpsError, match="cannot be part"),
            write_artefact(tmp_path / "a", "metrics", stage="s", config={}) as draft,
        ):
            if name == "link":
                (draft.folder / name).symlink_to("/etc/hostname")
            else:
                (draft.folder / name).write_text("x")


def test_nested_files_are_part_of_it(tmp_path):
    with write_artefact(tmp_path / "a", "metrics", stage="s", config={}) as draft:
        (draft.folder / "parts" / "1").mkdir(parents=True)
        (draft.folder / "parts" / "1" / "x.txt").write_text("x")
    artefact = open_artefact(tmp_path / "a")
    assert artefact.file("parts/1/x.txt").read_text() == "x"
    assert verify(tmp_path / "a") == []
    with pytest.raises(InputError, match="has no file"):
        artefact.file("../../x")


def test_new_data_folder_is_readable_by_all_that_the_umask_allows(tmp_path):
    umask = os.umask(0o022)
    try:
        artefact = write_text_artefact(tmp_path / "a", "x")
    finally:
        os.umask(umask)
    assert artefact.folder.stat().st_mode & 0o777 == 0o755


def test_unfinished_work_lies_beside(tmp_path):
    assert partial_folder(tmp_path / "run.v1") == tmp_path / "run.v1.partial"


def test_version_is_that_of_the_package():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    assert f'version = "{PUMPS_VERSION}"' in text
