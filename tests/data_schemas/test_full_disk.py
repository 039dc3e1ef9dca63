"""A disk that fills up while an artefact or a file is written: one sentence, the old one whole, nothing left over.

On a small file system where one may be mounted, and everywhere with a limit on the size of files, in a process of its
own, since a library that handles this badly crashes the process.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from data_schemas.artefact import open_artefact, verify
from tests.data_schemas.examples import write_text_artefact
from tests.data_schemas.large_artefacts import WRITERS

REPOSITORY = Path(__file__).parents[2]
SCRIPT = """
import sys
from pathlib import Path
from data_schemas.errors import PumpsError
from tests.data_schemas.large_artefacts import WRITERS
try:
    WRITERS[sys.argv[1]](Path(sys.argv[2]), 2)
except PumpsError as error:
    print(error)
    sys.exit(error.exit_code)
"""


def _write(kind: str, path: Path, limit_bytes: int | None) -> subprocess.CompletedProcess:
    def limit() -> None:
        if limit_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    return subprocess.run(
        [sys.executable, "-c", SCRIPT, kind, str(path)],
        cwd=REPOSITORY,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        preexec_fn=limit,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def _assert_refused(ended: subprocess.CompletedProcess, path: Path, words: str) -> None:
    assert ended.returncode == 1, ended.stderr[-2000:]
    assert ended.stderr == ""
    assert ended.stdout.startswith(f"{path} ") and words in ended.stdout and ended.stdout.count("\n") == 1
    assert ended.stdout.rstrip().endswith("another output.")


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("limit_bytes", [0, 3_000, 60_000, 200_000])
def test_a_limit_on_the_size_of_files(tmp_path, kind, limit_bytes):
    path = tmp_path / "out"
    ended = _write(kind, path, limit_bytes)
    _assert_refused(ended, path, "cannot be written: File too large.")
    assert list(tmp_path.iterdir()) == []
    WRITERS[kind](path, 1)
    before = {each: each.read_bytes() for each in path.rglob("*") if each.is_file()} or path.read_bytes()
    _assert_refused(_write(kind, path, limit_bytes), path, "cannot be written: File too large.")
    after = {each: each.read_bytes() for each in path.rglob("*") if each.is_file()} or path.read_bytes()
    assert after == before and [each.name for each in tmp_path.iterdir()] == ["out"]


@pytest.fixture
def small_disk(tmp_path):
    """An empty file system of 300 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(place)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip("no file system may be mounted here; the limit on the size of files is tested above")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("filled_bytes", [0, 200_000, 290_000])
def test_a_disk_that_is_full(small_disk, kind, filled_bytes):
    path = small_disk / "out"
    (small_disk / "other").write_bytes(bytes(filled_bytes))
    _assert_refused(_write(kind, path, None), path, "")
    assert [each.name for each in small_disk.iterdir()] == ["other"]


def test_the_old_artefact_stays_whole_on_a_full_disk(small_disk):
    path = small_disk / "out"
    for kind in ("motion", "tpc", "latent", "checkpoint", "metrics"):
        old = write_text_artefact(path, "old", kind=kind)
        _assert_refused(_write(kind, path, None), path, "")
        assert verify(path) == [] and open_artefact(path).manifest == old.manifest
        assert {each.name for each in path.iterdir()} == {"manifest.json", old.manifest.data}
        for each in sorted(path.rglob("*"), reverse=True):
            each.rmdir() if each.is_dir() else each.unlink()
