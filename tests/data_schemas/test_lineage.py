"""Where an artefact comes from, and whether it still would be the same."""

from __future__ import annotations

import shutil

import pytest

from data_schemas.artefact import lineage
from data_schemas.errors import InputError
from tests.data_schemas.examples import write_motion, write_text_artefact


@pytest.fixture
def run(tmp_path):
    """clips.zip -> motion -> encode and train -> evaluate, all in one run folder."""
    (tmp_path / "clips.zip").write_bytes(b"clips")
    run = tmp_path / "run"
    write_motion(run / "ingest", inputs=[tmp_path / "clips.zip"])
    write_text_artefact(run / "train", "weights", kind="checkpoint", stage="train-ae", inputs=[run / "ingest"])
    write_text_artefact(run / "evaluate", "table", inputs=[run / "ingest", run / "train"])
    return run


def _states(node) -> dict[str, str]:
    found = {node.path.name: node.state}
    for item in node.inputs:
        found |= _states(item)
    return found


def test_tree_of_a_run(run):
    tree = lineage(run / "evaluate")
    assert (tree.kind, tree.stage, tree.state, tree.licences) == ("metrics", "evaluate", "same", ("zlib",))
    ingest, train = tree.inputs
    assert (ingest.kind, ingest.stage) == ("motion", "ingest")
    assert (train.kind, train.stage) == ("checkpoint", "train-ae")
    assert train.inputs[0].digest == ingest.digest
    assert ingest.inputs[0].kind == "file" and ingest.inputs[0].path == run.parent / "clips.zip"
    assert set(_states(tree).values()) == {"same"}


def test_a_run_moves_as_a_whole(run):
    shutil.move(run.parent, run.parent.parent / "moved")
    moved = run.parent.parent / "moved" / "run"
    assert set(_states(lineage(moved / "evaluate")).values()) == {"same"}


def test_what_changed_since_is_named(run):
    write_motion(run / "ingest", seed=1, inputs=[run.parent / "clips.zip"])
    (run.parent / "clips.zip").write_bytes(b"other clips")
    assert _states(lineage(run / "evaluate")) == {
        "evaluate": "same",
        "train": "same",
        "ingest": "changed",
        "clips.zip": "changed",
    }


def test_what_is_gone_or_damaged_is_named(run):
    shutil.rmtree(run / "ingest")
    (run / "train" / "manifest.json").write_text("{")
    assert _states(lineage(run / "evaluate")) == {"evaluate": "same", "train": "damaged", "ingest": "missing"}
    with pytest.raises(InputError, match="not JSON"):
        lineage(run / "train")


def test_a_folder_of_sources_is_recorded_and_not_read_again(tmp_path):
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips" / "walk.bvh").write_text("x")
    first = write_text_artefact(tmp_path / "a", "x", inputs=[tmp_path / "clips"]).manifest.inputs[0]
    (tmp_path / "clips" / "walk.bvh").write_text("y")
    second = write_text_artefact(tmp_path / "b", "x", inputs=[tmp_path / "clips"]).manifest.inputs[0]
    assert first.kind == second.kind == "folder" and first.digest != second.digest
    assert lineage(tmp_path / "a").inputs[0].state == "unchecked"
    shutil.rmtree(tmp_path / "clips")
    assert lineage(tmp_path / "a").inputs[0].state == "missing"
