"""Manifests that are damaged, from the future, or made up to reach outside their folder."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from data_schemas.artefact import lineage, open_artefact, verify
from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from tests.data_schemas.examples import write_motion, write_text_artefact

SHA = "0" * 64


def _change(path: Path, **fields) -> None:
    manifest = json.loads((path / "manifest.json").read_text())
    manifest.update(fields)
    (path / "manifest.json").write_text(json.dumps(manifest))


@pytest.fixture
def path(tmp_path) -> Path:
    (tmp_path / "secret").write_text("x")
    write_text_artefact(tmp_path / "a", "x")
    return tmp_path / "a"


@pytest.mark.parametrize(
    "data",
    ["..", ".", "", "/", "/etc", "../a", "data-0123456789abcdef/..", "data-0123456789abcdef\n", "a\\b"],
)
def test_data_folder_must_be_a_plain_name(path, data):
    _change(path, data=data)
    with pytest.raises(InputError, match="data"):
        open_artefact(path)


@pytest.mark.parametrize(
    "name",
    ["../../secret", "/etc/passwd", "a/../../../secret", "", "a//b", ".", "a\\..\\b", "C:x", "a\0b"],
)
def test_files_must_stay_inside(path, name):
    _change(path, files={name: SHA})
    with pytest.raises(InputError, match="files"):
        open_artefact(path)


def test_links_that_lead_out_are_refused(path):
    artefact = open_artefact(path)
    (artefact.folder / "summary.md").unlink()
    (artefact.folder / "summary.md").symlink_to(path.parent / "secret")
    with pytest.raises(InputError, match="leads out"):
        open_artefact(path)


def test_data_folder_that_is_a_link_is_refused(path):
    artefact = open_artefact(path)
    artefact.folder.rename(path.parent / "elsewhere")
    artefact.folder.symlink_to(path.parent / "elsewhere")
    with pytest.raises(InputError, match="missing"):
        open_artefact(path)


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[]", "null", "7", '"text"', "[" * 100_000, "\udc80", "{}", '{"kind": 1, "schema_version": 1}'),
        *('{"kind": "metrics", "schema_version": "1"}', '{"kind": "metrics", "schema_version": true}'),
    ],
)
def test_no_manifest_at_all(path, text):
    (path / "manifest.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError, match=r"manifest\.json"):
        open_artefact(path)


@pytest.mark.parametrize(
    "fields",
    [
        *({"files": []}, {"files": {"summary.md": "short"}}, {"inputs": [{"path": 1}]}, {"config": None}),
        *({"digest": 5}, {"licences": "zlib"}, {"stage": None}),
    ],
)
def test_fields_of_the_wrong_type_are_named(path, fields):
    _change(path, **fields)
    with pytest.raises(InputError, match=f"damaged .*{next(iter(fields))}"):
        open_artefact(path)


def test_missing_and_wrong_places(tmp_path, path):
    with pytest.raises(InputError, match="does not exist"):
        open_artefact(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"has no manifest\.json"):
        open_artefact(tmp_path)
    with pytest.raises(InputError, match="is a file"):
        open_artefact(tmp_path / "secret")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_manifest_that_is_a_pipe_does_not_block(tmp_path):
    os.mkfifo(tmp_path / "manifest.json")
    with pytest.raises(InputError, match="not a plain file"):
        open_artefact(tmp_path)


def test_wrong_kind_says_what_is_needed(path):
    with pytest.raises(InputError, match="holds a 'metrics' artefact, but a 'motion' artefact is needed") as caught:
        MotionReader(path)
    assert "motions.h5" in str(caught.value.hint)
    with pytest.raises(InputError, match="holds a 'metrics' artefact"):
        MotionReader(open_artefact(path))


def test_newer_version_says_what_to_install(path):
    _change(path, schema_version=7, created_by="pumps 3.1.4", digest={"new": "form"})
    with pytest.raises(InputError, match="version 7") as caught:
        open_artefact(path)
    assert "pumps 3.1.4" in str(caught.value.hint)
    assert caught.value.exit_code == 3
    write_text_artefact(path, "y")  # an older pumps may still be told to write there


def test_unknown_kind(path):
    _change(path, kind="hologram")
    with pytest.raises(InputError, match="'hologram', which pumps"):
        open_artefact(path)


def test_lost_files_are_named(path):
    artefact = open_artefact(path)
    (artefact.folder / "summary.md").unlink()
    with pytest.raises(InputError, match=r"summary\.md is missing"):
        open_artefact(path)


def test_verify_finds_each_change(tmp_path):
    artefact = write_motion(tmp_path / "m")
    data = (artefact.folder / "motions.h5").read_bytes()
    (artefact.folder / "motions.h5").write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    (artefact.folder / "extra.txt").write_text("x")
    _change(tmp_path / "m", digest=SHA)
    problems = verify(tmp_path / "m")
    assert len(problems) == 4
    assert problems[0].startswith("motions.h5 has changed")
    assert problems[1] == "extra.txt is not listed in the manifest."
    assert "digest" in problems[2]
    assert problems[3].startswith("The manifest has changed")


def test_made_up_lineage_ends(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        write_text_artefact(tmp_path / name, name)
        _change(tmp_path / name, inputs=[{"path": f"../{other}", "kind": "metrics", "digest": SHA}] * 2)
    tree = lineage(tmp_path / "a")
    assert [node.state for node in tree.inputs] == ["changed", "changed"]
    assert [node.state for node in tree.inputs[0].inputs] == ["cyclic", "cyclic"]

    places = ("/dev/zero", "/", "x" * 5000, "../../../../../../../../etc")
    for kind, state in (("file", "missing"), ("metrics", "damaged")):
        _change(tmp_path / "a", inputs=[{"path": place, "kind": kind, "digest": SHA} for place in places])
        assert {node.state for node in lineage(tmp_path / "a").inputs} <= {state, "missing"}
    _change(tmp_path / "a", inputs=[{"path": "/", "kind": "folder", "digest": SHA}])
    assert lineage(tmp_path / "a").inputs[0].state == "unchecked"


def test_lineage_that_doubles_at_each_step_is_cut_short(tmp_path):
    for level in range(20):
        write_text_artefact(tmp_path / str(level), "x")
        _change(tmp_path / str(level), inputs=[{"path": f"../{level + 1}", "kind": "metrics", "digest": SHA}] * 2)
    pending, nodes = [lineage(tmp_path / "0")], 0
    while pending:
        nodes += 1
        pending.extend(pending.pop().inputs)
    assert nodes < 10_000
