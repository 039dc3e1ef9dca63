"""A kill at any instant leaves an artefact that is whole: the old one or the new one."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from data_schemas.artefact import open_artefact, verify
from data_schemas.motion import MotionReader
from tests.data_schemas.examples import write_motion, write_text_artefact

REPOSITORY = Path(__file__).parents[2]
STEPS = ("open", "mkdir", "fsync", "rename", "replace", "rmdir", "unlink")  # what changes the disk during a write

WRITER = """
import sys
from pathlib import Path
from tests.data_schemas.examples import write_motion
path = Path(sys.argv[1])
print("ready", flush=True)
for seed in range(10**9):
    write_motion(path, seed=seed % 7, frames=400)
"""


def _start_writer(path: Path) -> subprocess.Popen:
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], cwd=REPOSITORY, stdout=subprocess.PIPE, env=environment
    )
    assert writer.stdout is not None
    writer.stdout.readline()
    return writer


def _end(writer: subprocess.Popen) -> None:
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    assert writer.stdout is not None
    writer.stdout.close()


def _assert_whole(path: Path) -> None:
    assert verify(path) == []
    with MotionReader(path) as reader:
        assert reader.motion("walk").frames == 400


def _write_and_die(path: Path, kill_at: int) -> bool:
    """Write "new" in a child that is killed before its `kill_at`th step; False if it had fewer steps and finished."""
    child = os.fork()
    if child == 0:
        taken = 0

        def counted(real):
            def step(*arguments, **named):
                nonlocal taken
                if taken == kill_at:
                    os.kill(os.getpid(), signal.SIGKILL)
                taken += 1
                return real(*arguments, **named)

            return step

        try:
            for name in STEPS:
                setattr(os, name, counted(getattr(os, name)))
            write_text_artefact(path, "new")
        except BaseException:
            os._exit(1)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0
    return os.WIFSIGNALED(status)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_killed_before_every_step_of_a_write(tmp_path):
    """Kill the writer before each system call that changes the disk, one run for each."""
    outcomes = []
    for kill_at in range(200):
        path = tmp_path / f"run{kill_at}"
        write_text_artefact(path, "old")
        died = _write_and_die(path, kill_at)

        texts = {(open_artefact(path).folder / name).read_text() for name in ("summary.md", "copy.md")}
        assert verify(path) == []
        assert texts in ({"old"}, {"new"})  # never one file of each
        outcomes.append(texts.pop())

        write_text_artefact(path, "next")
        assert {p.name for p in path.iterdir()} == {"manifest.json", open_artefact(path).manifest.data}
        shutil.rmtree(path)
        if not died:
            break
    else:
        pytest.fail("the writer took more steps than this test kills")
    assert len(outcomes) > 10
    assert outcomes == sorted(outcomes, reverse=True)  # old until the swap, new ever after


def test_killed_at_random_instants(tmp_path):
    """SIGKILL a process that rewrites a motion artefact without pause."""
    path = tmp_path / "motion"
    write_motion(path, frames=400)
    instants = random.Random(0)
    for _ in range(5):
        writer = _start_writer(path)
        time.sleep(instants.uniform(0.0, 0.15))
        _end(writer)
        _assert_whole(path)
    artefact = write_motion(path, frames=400, seed=100)  # the dead writer's lock and drafts are no hindrance
    assert {p.name for p in path.iterdir()} == {"manifest.json", artefact.manifest.data}


def test_readers_never_see_a_half_artefact(tmp_path):
    """Read by path, again and again, while another process replaces the artefact."""
    path = tmp_path / "motion"
    write_motion(path, frames=400)
    writer = _start_writer(path)
    try:
        seen = set()
        until = time.monotonic() + 2
        while time.monotonic() < until:
            with MotionReader(path) as reader:
                assert reader.motion("walk").frames == 400
                seen.add(reader.artefact.manifest.digest)
        assert writer.poll() is None
    finally:
        _end(writer)
    assert len(seen) > 1
