"""`pumps artefact show|verify|lineage` as a user sees them."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from data_schemas.artefact import open_artefact
from tests.data_schemas.examples import write_motion, write_text_artefact

FROZEN = Path(__file__).parents[1] / "data_schemas" / "frozen" / "motion_version_2"


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "clips.zip").write_bytes(b"clips")
    write_motion(tmp_path / "ingest", inputs=[tmp_path / "clips.zip"], config={"sources": ["clips.zip"]})
    write_text_artefact(tmp_path / "train", "x", kind="checkpoint", stage="train-ae", inputs=[tmp_path / "ingest"])
    inputs = [tmp_path / "train", tmp_path / "ingest", tmp_path / "train"]
    write_text_artefact(tmp_path / "evaluate", "x", inputs=inputs)
    return tmp_path


@pytest.fixture
def artefact(pumps):
    """`artefact("show", path)` -> exit code, stdout, stderr."""

    def call(*words: str) -> tuple[int, str, str]:
        ran = pumps("artefact", *words)
        return ran.code, ran.out, ran.err

    return call


def test_show(run, artefact):
    code, out, _ = artefact("show", "ingest")
    digest = open_artefact("ingest").manifest.digest
    assert code == 0
    assert out.startswith("ingest: motion, version 3 (motions on their skeletons")
    for words in (
        "made by   ingest (pumps 0.1.0)",
        digest,
        "    zlib",
        "../clips.zip (file",
        "motions.h5 (",
        "clips.zip",
    ):
        assert words in out
    assert "  summary   none" in out
    code, out, _ = artefact("show", "ingest", "--json")
    assert code == 0 and json.loads(out)["digest"] == digest


def test_verify(run, artefact):
    whole = "ingest: 2 files and the manifest are as they were written.\n"
    assert artefact("verify", "ingest") == (0, whole, "")
    _, out, _ = artefact("verify", str(FROZEN), "--json")
    assert json.loads(out) == {"path": str(FROZEN), "problems": [], "manifest_covered": False}
    code, out, _ = artefact("verify", str(FROZEN))
    assert code == 0 and "An older pumps wrote it: its config, inputs, licences and summary are not covered" in out
    manifest = Path("ingest/manifest.json")
    before = manifest.read_text()
    manifest.write_text(before.replace('"zlib"', '"CC0"'))
    code, out, _ = artefact("verify", "ingest")
    assert code == 3 and "The manifest has changed" in out
    manifest.write_text(before)
    open_artefact("ingest").file("motions.h5").write_bytes(b"x")
    code, out, _ = artefact("verify", "ingest")
    assert code == 3 and out.startswith("ingest: motions.h5 has changed")
    code, out, _ = artefact("verify", "ingest", "--json")
    assert code == 3 and len(json.loads(out)["problems"]) == 1
    assert artefact("verify", "ingest", "--quiet") == (3, "", "")


def test_lineage_draws_each_part_once(run, artefact):
    code, out, _ = artefact("lineage", "evaluate")
    shapes = [line.split("  ")[0] if "─" not in line else line[: line.index("─ ") + 2] for line in out.splitlines()]
    assert code == 0
    assert shapes == ["evaluate", "├─ ", "│  └─ ", "│     └─ ", "├─ ", "└─ "]
    assert out.count("(see above)") == 2
    assert "clips.zip  file" in out and "train  checkpoint by train-ae" in out
    code, out, _ = artefact("lineage", "evaluate", "--json")
    assert [item["kind"] for item in json.loads(out)["inputs"]] == ["checkpoint", "motion", "checkpoint"]


def test_lineage_names_what_changed_or_is_gone(run, artefact):
    write_motion(run / "ingest", seed=1)
    shutil.rmtree(run / "train")
    _, out, _ = artefact("lineage", "evaluate")
    assert "ingest  motion by ingest" in out and "CHANGED since it was read" in out and "MISSING" in out


def test_bad_input_is_one_sentence_and_exit_code_3(run, artefact):
    for command in ("show", "verify", "lineage"):
        code, out, err = artefact(command, "nowhere")
        assert (code, out) == (3, "")
        assert err == "pumps: nowhere does not exist. Run the stage that makes it first.\n"


def test_a_made_up_manifest_sends_nothing_to_the_terminal(run, artefact):
    path = run / "evaluate" / "manifest.json"
    manifest = json.loads(path.read_text())
    nasty = "\x1b[2J\x07"
    path.write_text(json.dumps(manifest | {"licences": [nasty], "summary": {nasty: nasty}}))
    for command in ("show", "lineage"):
        code, out, _ = artefact(command, "evaluate")
        assert code == 0 and "\x1b" not in out and "\x07" not in out
    for field in ("stage", "created_by", "kind"):
        path.write_text(json.dumps(manifest | {field: nasty}))
        for command in ("show", "lineage"):
            code, out, err = artefact(command, "evaluate")
            assert code == 3 and "\x1b" not in out + err and "\x07" not in out + err


@pytest.mark.parametrize("words", [[], ["show"], ["verify"], ["lineage"]])
def test_help_has_an_example(artefact, words):
    code, out, _ = artefact(*words, "--help")
    assert code == 0 and "Example: pumps artefact" in out


def test_help_loads_no_heavy_library():
    program = (
        "import sys, contextlib\nfrom pumps_cli.app import main\n"
        "with contextlib.suppress(SystemExit): main(['artefact', 'show', '--help'])\n"
        "print(sorted({'torch', 'h5py', 'pyarrow', 'scipy'} & set(sys.modules)), file=sys.stderr)"
    )
    root = Path(__file__).parents[2]
    ended = subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, text=True, check=True)
    assert ended.stderr.strip() == "[]"
