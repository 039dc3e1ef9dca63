"""A disk that fills up while an artefact or a file is written: one sentence, the old one whole, nothing left over.

On a small file system where one may be mounted, and everywhere with a limit on the size of files. The writers run in
a process of their own, since a library that handles this badly crashes the process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.data_schemas.large_artefacts import WRITERS

REPOSITORY = Path(__file__).parents[2]
SCRIPT = """
import json, resource, sys
from pathlib import Path
from data_schemas.errors import PumpsError
from tests.data_schemas.large_artefacts import WRITERS

place, limit = Path(sys.argv[1]), int(sys.argv[2])

def content(path):
    return {str(each): each.read_bytes().hex() for each in [path, *path.rglob("*")] if each.is_file()}

for kind, write in WRITERS.items():
    path = place / kind
    old = json.loads(sys.argv[3])
    if old:
        write(path, 0)
    before, others = content(path), sorted(each.name for each in place.iterdir())
    if limit >= 0:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        write(path, 2)
        said = None
    except PumpsError as error:
        said = [error.exit_code, str(error)]
    if limit >= 0:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    kept = content(path) == before and sorted(each.name for each in place.iterdir()) == others
    print(json.dumps([kind, said, kept]), flush=True)
"""


def _write_all(place: Path, limit_bytes: int, old: bool) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(place), str(limit_bytes), json.dumps(old)],
        cwd=REPOSITORY,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert ended.returncode == 0 and ended.stderr == "", ended.stderr[-3000:]
    found = [json.loads(line) for line in ended.stdout.splitlines()]
    assert [kind for kind, _, _ in found] == list(WRITERS)
    for kind, said, kept in found:
        assert said is not None, f"{kind} was written although it does not fit"
        assert said[0] == 1 and said[1].startswith(f"{place / kind}"), said
        assert said[1].endswith("Free space on that disk, or give another output.") and "\n" not in said[1]
        assert kept, f"{kind}: the old one has changed, or something is left over"


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("limit_bytes", [0, 3_000, 60_000])
def test_a_limit_on_the_size_of_files(tmp_path, limit_bytes, old):
    _write_all(tmp_path, limit_bytes, old)


@pytest.fixture
def small_disk(tmp_path):
    """An empty file system of 500 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=500k", "tmpfs", str(place)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip("no file system may be mounted here; the limit on the size of files is tested above")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("filled_bytes", [0, 150_000])
def test_a_disk_that_is_full(small_disk, filled_bytes, old):
    (small_disk / "other").write_bytes(bytes(filled_bytes))
    _write_all(small_disk, -1, old)
