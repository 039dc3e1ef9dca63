"""A run followed without make: the commands that GNU make would run, nothing twice, and nothing after a failure."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import open_artefact
from stages.shared.settings.recipes import embedded_clips, read_recipe
from stages.shared.settings.run_folder import RunRequest, write_run
from stages.shared.settings.run_following import commands_of, follow
from stages.shared.settings.run_steps import items_of

PARAMETERS = ("weights=small",)
CLIPS = ("a", "b c")
NOW = int(time.time())  # weights that come with pumps are older


class Fake:
    """Runs no command: touches the file that says that it is done, each later than all before."""

    def __init__(self, clips: Sequence[str] = CLIPS, later: int = 0) -> None:
        self.ran: list[list[str]] = []
        self.clips, self.time, self.fails_at = clips, NOW + later, ""

    def __call__(self, words: Sequence[str]) -> None:
        self.ran.append(list(words))
        output = Path(words[words.index("-o") + 1])
        if self.fails_at and self.fails_at in output.as_posix():
            raise InputError("It failed.")
        if "data pick" in " ".join(words[:2]):
            for clip in self.clips:
                self.touch(output / f"{clip}.bvh")
            self.touch(output / "clips.txt")
        self.touch(output if output.suffix else output / "manifest.json")

    def touch(self, path: Path) -> None:
        self.time += 1
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        os.utime(path, (self.time, self.time))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "mine"
    write_run(RunRequest(folder, ("tiny",), sources=(embedded_clips(),), parameters=PARAMETERS))
    for path in (folder / "config").iterdir():
        os.utime(path, (0, 0))
    return folder


def followed(run: Path, fake: Fake) -> list[list[str]]:
    fake.ran = []
    follow(read_recipe("", PARAMETERS), run, "run", fake)
    return fake.ran


def by_make(run: Path) -> list[str]:
    """The outputs of the commands that GNU make would run."""
    command = ["make", "-n", "-f", str(run / "run.mk"), f"R={run}", "PUMPS=pumps"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return re.findall(r"^pumps (?!results).* -o (.+?)(?:  )?$", shown, re.MULTILINE)


def outputs(commands: Sequence[Sequence[str]]) -> list[str]:
    return [each[each.index("-o") + 1] for each in commands]


def test_each_command_runs_once_after_what_it_needs_and_never_again(run: Path) -> None:
    fake = Fake()
    made = [Path(each).relative_to(run).as_posix() for each in outputs(followed(run, fake))]
    assert sorted(made) == sorted({*made}) and made[0] == "ingest"
    assert made.index("train-ae") < made.index("train-lms") < made.index("infill/a.bvh")
    assert {f"infill/{clip}.bvh" for clip in CLIPS} | {f"infill-small/{clip}.bvh" for clip in CLIPS} < {*made}
    page = next(each for each in fake.ran if each[0] == "report")
    assert f"b c/PUMPS={run}/infill/b c.bvh" in page
    assert not followed(run, fake)


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_what_is_out_of_date_is_what_make_says(run: Path, data) -> None:
    """Clips have names without spaces here, since make's lists are divided at spaces."""
    if not (run / "ingest").exists():
        followed(run, Fake(("a", "b")))
    with tempfile.TemporaryDirectory() as folder:
        changed = Path(shutil.copytree(run, Path(folder) / "mine"))
        fake = Fake(("a", "b"), later=1_000)
        files = sorted(path for path in changed.rglob("*") if path.is_file() and path.name != "run.mk")
        for path in data.draw(st.lists(st.sampled_from(files), max_size=3, unique=True)):
            fake.touch(path)
        for path in data.draw(st.lists(st.sampled_from(files), max_size=2, unique=True)):
            if path.parent.name != "config" and "data-pick" not in path.parts:
                path.unlink()
        wanted = {*by_make(changed)}  # the second make of a goal shows what the first one has shown
        assert sorted(outputs(followed(changed, fake))) == sorted(wanted)


def test_a_failure_ends_the_run_and_the_next_call_goes_on(run: Path) -> None:
    fake = Fake()
    fake.fails_at = "/encode"
    with pytest.raises(InputError, match="failed"):
        followed(run, fake)
    assert outputs(fake.ran)[-1].endswith("/encode")
    done, fake.fails_at = set(outputs(fake.ran)[:-1]), ""
    assert not done & {*outputs(followed(run, fake))}


def test_a_training_that_stops_before_its_end_says_so(run: Path) -> None:
    fake = Fake()

    def stops(words: Sequence[str]) -> None:
        if words[:2] == ["train", "ae"]:
            assert list(words[-2:]) == ["--max-time", "3"]
        else:
            fake(words)

    with pytest.raises(InputError, match="stopped before") as raised:
        follow(read_recipe(""), run, "run", stops, max_time=3)
    assert raised.value.hint == "Run it again to go on."


def test_goals_are_named(run: Path) -> None:
    with pytest.raises(UsageError, match="no goal 'pages'"):
        list(commands_of(read_recipe(""), run, "pages"))


def test_items_come_in_the_order_of_the_list(tmp_path: Path) -> None:
    recipe = read_recipe("solve")
    name, files = next((name, each) for name, each in recipe.lists.items())
    assert name and files.files.count("*") >= 1
    head, tail = files.files.split("*", 1)[0], files.files.rsplit("*", 1)[1]
    for item in ("z/last", "a/b", *(f"m/{each}" for each in files.first)):
        path = tmp_path / f"{head}{item}{tail}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    assert items_of(files, tmp_path) == [*(f"m/{each}" for each in files.first), "a/b", "z/last"]


RECIPE = """
preset = "tiny"

[data]
embedded = "alone"

[goals.run]
nodes = ["ingest"]

[nodes.ingest]
stage = "ingest"
"""


CLOUDS = (
    RECIPE.replace('"ingest"]', '"sample-tpc"]')
    + """
[nodes.sample-tpc]
stage = "sample-tpc"
inputs = { motion = "ingest" }
"""
)


def test_the_same_recipe_by_make_and_without_gives_the_same_content(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(CLOUDS)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "OMP_NUM_THREADS": "1"}
    pumps = [sys.executable, "-m", "pumps_cli"]
    for words in (
        [*pumps, "run", "own.toml", "--run", "without"],
        [*pumps, "config", "write", "--recipe", "own.toml", "--run", "by-make"],
        ["make", "-f", "by-make/run.mk", "R=by-make", f"PUMPS={' '.join(pumps)}", "run"],
    ):
        made = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, env=environment)
        assert made.returncode == 0, made.stdout + made.stderr
    for stage in ("ingest", "sample-tpc"):
        one, other = (open_artefact(tmp_path / run / stage) for run in ("without", "by-make"))
        assert one.manifest.digest == other.manifest.digest
        assert _bytes_of(one.folder) == _bytes_of(other.folder)


def _bytes_of(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_recipe_of_ones_own_is_made_by_one_command(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(RECIPE)
    command = [sys.executable, "-m", "pumps_cli", "run", "own.toml"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}

    def shown() -> str:
        made = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment)
        assert made.returncode == 0, made.stderr
        return made.stdout

    assert shown().startswith("pumps ingest auto --config runs/own/config/ingest.toml")
    assert (tmp_path / "runs/own/ingest/manifest.json").is_file()
    assert shown() == "All of runs/own is up to date.\n"
