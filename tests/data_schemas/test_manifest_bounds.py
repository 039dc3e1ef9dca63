"""Each field of a manifest is bounded when it is opened and when it is written; a fault is one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.errors import InputError, PumpsError
from tests.data_schemas.examples import write_text_artefact

SHA = "0" * 64
SCRIPT = "<script>alert(1)</script>"
LONG = "x" * 100_001


def _nested(levels: int) -> dict:
    value: dict = {}
    for _ in range(levels):
        value = {"a": value}
    return value


BAD = {
    "digest": [SCRIPT, "", "0" * 63, "0" * 65, "G" * 64, "A" * 64, f"{SHA}\n"],
    "created_by": [SCRIPT, "pumps", "pumps <b>", "other 1.0", "pumps 1\n2", f"pumps {'1' * 100}"],
    "stage": [SCRIPT, "", "a\nb", "a" * 81, "-o", "\x1b[31m"],
    "schema_version": [-(10**7)],
    "manifest_version": [-(10**7)],
    "licences": [[LONG], ["a"] * 10_001, [5]],
    "inputs": [
        [{"path": "a", "kind": "file", "digest": SCRIPT}],
        [{"path": "a", "kind": SCRIPT, "digest": SHA}],
        [{"path": "a\0b", "kind": "file", "digest": SHA}],
        [{"path": "x" * 9000, "kind": "file", "digest": SHA}],
    ],
    "files": [{"a": SCRIPT}, {"a/" * 600 + "b": SHA}, {SCRIPT: SHA}],
    "content": [{"a": SCRIPT}, {SCRIPT: SHA}],
    "config": [{"a": LONG}, {LONG: 1}, {"a": 2**200}, {"a": float("nan")}, _nested(60)],
    "summary": [{"a": [[LONG]]}, {"a": float("inf")}, _nested(60)],
    "manifest_digest": [SCRIPT, "0" * 63],
}


@pytest.fixture
def path(tmp_path) -> Path:
    return write_text_artefact(tmp_path / "a", "x").path


@pytest.mark.parametrize(("field", "value"), [(field, value) for field, values in BAD.items() for value in values])
def test_a_field_out_of_bounds_is_refused_in_one_sentence(path, field, value):
    manifest = json.loads((path / "manifest.json").read_text())
    (path / "manifest.json").write_text(json.dumps({**manifest, field: value}))
    with pytest.raises(InputError, match=field) as caught:
        open_artefact(path)
    assert len(caught.value.message) < 1500 and "\n" not in caught.value.message
    assert caught.value.message.endswith(").") and caught.value.message.isprintable()


@pytest.mark.parametrize("kind", [SCRIPT, "\x1b[2J", "a" * 100, "a\nb"])
def test_a_kind_that_is_not_a_plain_name_is_not_repeated(path, kind):
    manifest = json.loads((path / "manifest.json").read_text())
    (path / "manifest.json").write_text(json.dumps({**manifest, "kind": kind}))
    with pytest.raises(InputError, match="is not a manifest") as caught:
        open_artefact(path)
    assert kind not in str(caught.value)


@pytest.mark.parametrize(
    "given", [{"config": {"a": LONG}}, {"licences": [LONG]}, {"config": _nested(60)}, {"stage": SCRIPT}]
)
def test_a_manifest_that_could_not_be_opened_is_not_written(path, given):
    before = (path / "manifest.json").read_bytes()
    with (
        pytest.raises(PumpsError, match="cannot hold this"),
        write_artefact(path, "metrics", **{"stage": "s", "config": {}, **given}) as draft,
    ):
        (draft.folder / "summary.md").write_text("new")
    assert (path / "manifest.json").read_bytes() == before
    assert (open_artefact(path).folder / "summary.md").read_text() == "x"
    assert len(list(path.iterdir())) == 2
