"""A kill at any instant leaves an artefact that is whole: the old one or the new one.

The kills aim at the moments between the draft and the swap: before each system call that changes the disk, and before
and after each step of the write, for every kind of artefact.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from data_schemas import artefact
from data_schemas.artefact import open_artefact, verify
from data_schemas.motion import MotionReader
from data_schemas.whole_file import write_whole
from tests.data_schemas.examples import write_motion, write_text_artefact
from tests.data_schemas.large_artefacts import WRITERS

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


def _killed_before(write: Callable[[], object], kill_at: int) -> bool:
    """Run a write in a child that is killed before its `kill_at`th step; False if it had fewer steps and finished."""
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
            write()
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
        died = _killed_before(lambda place=path: write_text_artefact(place, "new"), kill_at)

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


# The steps of `data_schemas.artefact.write_artefact`, in their order; the one before the last swaps the manifest.
MOMENTS = ("make_own_folder", "_hash_and_flush", "_settle", "_swap_manifest", "_remove_leftovers")


def _die_at(write, path: Path, moment: str, after: bool) -> None:
    """Run a write in a child that is killed before or after the last call of one of the write's steps."""
    child = os.fork()
    if child == 0:
        real = getattr(artefact, moment)
        last = {"make_own_folder": 2, "_remove_leftovers": 2}.get(moment, 1)
        calls = 0

        def step(*arguments, **named):
            nonlocal calls
            calls += 1
            if calls == last and not after:
                os.kill(os.getpid(), signal.SIGKILL)
            result = real(*arguments, **named)
            if calls == last:
                os.kill(os.getpid(), signal.SIGKILL)
            return result

        try:
            setattr(artefact, moment, step)
            write(path, 1)
        finally:
            os._exit(1)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("kind", [kind for kind in WRITERS if kind != "file"])
def test_killed_between_the_draft_and_the_swap(tmp_path, kind):
    path, write = tmp_path / "a", WRITERS[kind]
    write(path, 0)
    old = open_artefact(path).manifest
    states = []
    for moment in MOMENTS:
        for after in (False, True):
            _die_at(write, path, moment, after)
            found = open_artefact(path).manifest
            assert verify(path) == []
            states.append("old" if found == old else "new")
            write(path, 0)
            here = {each.name for each in path.iterdir()}
            assert here == {"manifest.json", open_artefact(path).manifest.data}
            old = open_artefact(path).manifest
    assert states == ["old"] * 7 + ["new"] * 3


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_file_killed_before_every_step_of_its_write(tmp_path):
    path = tmp_path / "a.bvh"
    found = []
    for kill_at in range(50):
        path.write_bytes(b"old" * 100)
        died = _killed_before(lambda: write_whole(path, b"new" * 200), kill_at)
        found.append(path.read_bytes()[:3].decode())
        assert path.read_bytes() in (b"old" * 100, b"new" * 200)
        if not died:
            break
    assert not died and found == sorted(found, reverse=True) and found[-1] == "new" and found.count("old") > 3


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
