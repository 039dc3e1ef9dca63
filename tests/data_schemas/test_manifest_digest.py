"""`verify` finds a change in any field of a manifest; older artefacts stay readable and say that they are older."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from data_schemas.artefact import covers_manifest, open_artefact, verify
from data_schemas.errors import InputError
from data_schemas.manifest import MANIFEST_VERSION
from tests.data_schemas.examples import write_motion, write_text_artefact

FROZEN = Path(__file__).parent / "frozen"
EDITS = {
    "licences": ["CC0"],
    "inputs": [],
    "config": {"seed": 5},
    "summary": {"clips": 9},
    "created_by": "pumps 9.9",
    "stage": "other",
    "content": {},
    "manifest_digest": "0" * 64,
}


def _edit(path: Path, **fields) -> None:
    manifest = json.loads((path / "manifest.json").read_text())
    (path / "manifest.json").write_text(json.dumps({**manifest, **fields}))


@pytest.mark.parametrize("field", EDITS)
def test_an_edited_field_is_found(tmp_path, field):
    write_text_artefact(tmp_path / "source", "x")
    write_motion(tmp_path / "m", inputs=[tmp_path / "source"])
    assert verify(tmp_path / "m") == [] and covers_manifest(open_artefact(tmp_path / "m").manifest)
    if field == "created_by":
        assert open_artefact(tmp_path / "m").manifest.created_by != EDITS[field]
    _edit(tmp_path / "m", **{field: EDITS[field]})
    assert any("manifest has changed" in problem for problem in verify(tmp_path / "m"))


def test_an_added_field_and_another_layout_of_the_text(tmp_path):
    write_motion(tmp_path / "m")
    _edit(tmp_path / "m")  # the same fields on one line
    assert verify(tmp_path / "m") == []
    _edit(tmp_path / "m", note="added")
    assert len(verify(tmp_path / "m")) == 1


def test_a_manifest_cannot_pass_for_an_older_one(tmp_path):
    write_motion(tmp_path / "m", licences=["CC BY-NC 4.0"])
    manifest = json.loads((tmp_path / "m" / "manifest.json").read_text())
    for name in ("manifest_version", "manifest_digest", "content"):
        del manifest[name]
    (tmp_path / "m" / "manifest.json").write_text(json.dumps({**manifest, "licences": ["CC0"]}))
    assert verify(tmp_path / "m") == ["The manifest's digest does not match the files it lists."]


@pytest.mark.parametrize("path", sorted(FROZEN.iterdir()), ids=lambda path: path.name)
def test_older_artefacts_are_read_and_their_files_checked(path):
    manifest = open_artefact(path).manifest
    assert manifest.manifest_version == 1 and not covers_manifest(manifest) and verify(path) == []


def test_a_manifest_of_a_newer_version_is_refused(tmp_path):
    write_motion(tmp_path / "m")
    _edit(tmp_path / "m", manifest_version=MANIFEST_VERSION + 1, created_by="pumps 3.1.4", digest=["new"])
    with pytest.raises(InputError, match=f"manifest of version {MANIFEST_VERSION + 1}") as caught:
        open_artefact(tmp_path / "m")
    assert "pumps 3.1.4" in str(caught.value.hint)


def test_content_that_was_not_what_is_stored_is_found(tmp_path):
    """The bytes' sha256 and the manifest's own digest are made again, the digest of the content is not."""
    from data_schemas.manifest import digest_of_manifest, sha256_of_file

    artefact = write_text_artefact(tmp_path / "a", "text")
    (artefact.folder / "summary.md").write_text("other")
    raw = json.loads((tmp_path / "a" / "manifest.json").read_text())
    raw["files"]["summary.md"] = sha256_of_file(artefact.folder / "summary.md")
    raw["manifest_digest"] = digest_of_manifest(raw)
    (tmp_path / "a" / "manifest.json").write_text(json.dumps(raw))
    assert verify(tmp_path / "a") == ["summary.md does not hold what the manifest's digest was made of."]
