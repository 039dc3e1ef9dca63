"""The pipeline for real, small: make runs every stage on four embedded clips, is killed in between, and goes on.

Then the commands that the pages show are run on what it made.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from data_schemas.artefact import verify
from data_schemas.checkpoint import read_checkpoint
from data_schemas.manifest import open_artefact
from data_schemas.metrics import read_metrics
from stages.shared.formats.bvh import read_bvh
from tests.docs.pages import ROOT, commands
from tests.pipeline.tiny_pipeline import CLIPS, SETTINGS, TRAINING

ARTEFACTS = ("ingest", "sample-tpc", "train-ae", "encode", "train-lms", "decode", "evaluate")


class Pipeline:
    """A place with the data, the run and a link to the embedded clips, as a user's clone has them."""

    def __init__(self, place: Path, python: tuple[str, ...]):
        self.place, self.pumps = place, (*python, "-m", "pumps_cli")
        self.run = place / "runs" / "demo"
        self.data = place / "data"
        self.data.mkdir(parents=True)
        (place / "stages").symlink_to(ROOT / "stages")
        (place / "docs").symlink_to(ROOT / "docs")
        splits = json.loads((CLIPS / "splits.json").read_text())["clips"]
        train = sorted({path.name for path in CLIPS.glob("*.bvh")} - {*splits["test"], *splits["val"]})
        for name in (*train[:2], splits["val"][0], splits["test"][0]):
            shutil.copy(CLIPS / name, self.data / name)
        (self.data / "splits.json").write_text(
            json.dumps({"data": {"test": [splits["test"][0]], "val": [splits["val"][0]]}})
        )

    def make(self, **options: object) -> subprocess.Popen[str]:
        """Start `make fill` in a process group of its own."""
        settings = " ".join(f"{name}={json.dumps(value, separators=(',', ':'))}" for name, value in SETTINGS.items())
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
        command = [
            "make", "fill", f"PUMPS={' '.join(self.pumps)}", f"RUNS={self.place / 'runs'}", "RUN=demo",
            f"DATA={self.data}", "PRESET=tiny", f"SET={settings}",
        ]  # fmt: skip
        environment = {**kept, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(
            command, cwd=ROOT, env=environment, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def finish(self) -> str:
        """Run it to the end and give what it printed."""
        process = self.make()
        printed, _ = process.communicate(timeout=500)
        assert process.returncode == 0, printed
        return printed

    def times(self) -> dict[str, int]:
        """When each finished artefact was written."""
        found = {name: self.run / name / "manifest.json" for name in ARTEFACTS}
        return {name: path.stat().st_mtime_ns for name, path in found.items() if path.exists()}


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory: pytest.TempPathFactory, fast_python: tuple[str, ...]) -> Pipeline:
    """A pipeline that was killed outright in the middle of the first training, and then ran to its end."""
    pipeline = Pipeline(tmp_path_factory.mktemp("pipeline"), fast_python)
    killed = pipeline.make()
    partial = pipeline.run / "train-ae.partial" / "checkpoints"
    deadline = time.monotonic() + 200
    while killed.poll() is None and not (partial.is_dir() and any(partial.iterdir())):
        assert time.monotonic() < deadline, "the training never wrote a checkpoint"
        time.sleep(0.02)
    if killed.poll() is None:
        os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate()
    pipeline.before = pipeline.times()  # type: ignore[attr-defined]
    pipeline.printed = pipeline.finish()  # type: ignore[attr-defined]
    return pipeline


def test_a_killed_run_goes_on_and_does_nothing_twice(pipeline: Pipeline):
    before = pipeline.before  # type: ignore[attr-defined]
    assert {"ingest", "sample-tpc"} <= set(before) and "evaluate" not in before
    after = pipeline.times()
    assert set(after) == set(ARTEFACTS)
    assert {name: after[name] for name in before} == before
    assert not list(pipeline.run.glob("*.partial"))


def test_every_artefact_is_whole(pipeline: Pipeline):
    for name in ARTEFACTS:
        assert verify(pipeline.run / name) == [], name


def test_training_logged_every_step_once_across_the_kill(pipeline: Pipeline):
    log = read_checkpoint(open_artefact(pipeline.run / "train-ae", "checkpoint")).log
    steps = [row["step"] for row in log if row["split"] == "val"]
    assert steps == sorted(set(steps)) and steps[-1] == TRAINING["steps"]


def test_what_it_prints_at_the_end(pipeline: Pipeline):
    printed = pipeline.printed  # type: ignore[attr-defined]
    for word in ("L2P", "L2Q", "NPSS", "lerp", "slerp", "pumps"):
        assert word in printed, word
    page = Path(printed.rstrip().rpartition("Report: ")[2])
    assert page == pipeline.run / "report" / "report.html"
    text = page.read_text()
    assert "<canvas" in text and "http://" not in text.replace("http://www.w3.org", "") and "https://" not in text


def test_metrics_hold_the_plain_ways_and_the_trained_one(pipeline: Pipeline):
    rows, _ = read_metrics(pipeline.run / "evaluate")
    assert {"lerp", "slerp", "pumps"} <= {row.method for row in rows}
    assert {"l2p_m", "l2q", "npss"} <= {row.metric for row in rows}


def test_the_filled_clip_keeps_header_and_keys(pipeline: Pipeline):
    (filled,) = (pipeline.run / "infill").glob("*.bvh")
    source = (pipeline.run / "data-pick" / filled.name).read_bytes()
    assert source in [path.read_bytes() for path in pipeline.data.glob("*.bvh")]
    given, made = read_bvh(source, "given"), read_bvh(filled.read_bytes(), "made")
    assert made.header == given.header and made.values.shape == given.values.shape
    keys = [*range(0, len(given.values), 15), len(given.values) - 1]
    assert (made.values[keys] == given.values[keys]).all()
    assert (made.values != given.values).any()


def test_again_runs_no_stage(pipeline: Pipeline):
    before = pipeline.times()
    printed = pipeline.finish()
    assert pipeline.times() == before
    assert "pumps_cli ingest" not in printed and "Report: " in printed


# Lines on data that is not here, or on a run that takes an hour, are only held to be well-formed (tests/docs).
ELSEWHERE = (
    "recordings", "runs/reproduce", "runs/mine", "runs/more", "runs/small", "runs/skeleton", "runs/asf",
    "runs/weights", "--cluster", "--weights mine ", "weights.toml", "example.org", "--weights walks",
)  # fmt: skip
PAGE_LINES = [
    line for _, line in commands() if line.startswith("pumps ") and not any(word in line for word in ELSEWHERE)
]


def test_the_commands_of_the_pages_do_what_they_say(pipeline: Pipeline):
    """Each one as it stands there, in a folder where runs/demo exists; those with shipped weights where there are."""
    shipped = (ROOT / "stages" / "shared" / "weights" / "small-free" / "ae" / "manifest.json").exists()
    for line in PAGE_LINES:
        words = shlex.split(line)[1:]
        needs_shipped = {"small-free", "small"} & set(words) if "--weights" in words else words[0] == "infill"
        if needs_shipped and not shipped:
            continue
        if words[0] == "evaluate":
            words += ["--max-windows", "1", "--points", "32", "--intervals", "15", "--transitions", "15"]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [*pipeline.pumps, *words], cwd=pipeline.place, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
