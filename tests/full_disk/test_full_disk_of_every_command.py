"""A disk that fills up under each command that writes: one sentence, the old output whole, nothing left over."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import typer

from pumps_cli.app import build_app, tool_words
from stages.registry import STAGES
from stages.shared.contract import WritingConfig
from tests.full_disk.writing_commands import CLIPS, FIRST_FORMS, PREPARED, PRINTING, WRITINGS
from tests.shared.catalogue.loopback import loopback_server
from tests.shared.inference.examples import write_random_weights
from tests.shared.meshes.figures import write_bodies
from tests.weights.fetch.archives_made import registry_of, tar_of

REPOSITORY = Path(__file__).parents[2]
DOWNLOAD = bytes(range(256)) * 400


@pytest.fixture
def catalogue() -> Iterator[str]:
    """A catalogue of one data set, which a server on this machine has."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Length", str(len(DOWNLOAD)))
            self.end_headers()
            self.wfile.write(DOWNLOAD)

        def log_message(self, format: str, *args: object) -> None: ...

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    yield (
        '[walks]\ntitle = "Walks"\nformat = "BVH"\nhome = "http://example.org"\nlicence = "CC BY 4.0"\n'
        'licence_url = "http://example.org/licence"\nterms = "Name us."\ningest = "pumps ingest bvh {file} -o out"\n'
        f'[[walks.files]]\nname = "walks.zip"\nurl = "http://127.0.0.1:{server.server_address[1]}/walks.zip"\n'
        f'bytes = {len(DOWNLOAD)}\nchecksum = "sha256:{hashlib.sha256(DOWNLOAD).hexdigest()}"\n'
    )
    server.shutdown()


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[str]:
    """A registry of weights, which a server on this machine has."""
    write_random_weights(tmp_path / "weights")
    with loopback_server(tar_of(tmp_path / "weights")) as (behaviour, address):
        yield registry_of(behaviour.content, url=f"{address}/walks.tar")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 8 MB where one may be mounted, else a plain folder."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(place)], capture_output=True, check=False
    )
    yield place
    if mounted.returncode == 0:
        subprocess.run(["umount", str(place)], check=True)


def test_every_command_that_writes_is_tried() -> None:
    tried = {writing.command for writing in WRITINGS}
    for stage in STAGES:
        writes = bool(stage.writes) or issubclass(stage.config_type(), WritingConfig)
        if writes and not stage.form_of:  # a form is the same stage
            assert " ".join(stage.command) in tried, f"add `pumps {' '.join(stage.command)}` to WRITINGS"
    for word in tool_words():
        found = typer.main.get_command(build_app(word)).commands[word]  # type: ignore[attr-defined]
        commands = [f"{word} {each}" for each in found.commands] if hasattr(found, "commands") else [word]
        for command in commands:
            assert command in tried | PRINTING, f"add `pumps {command}` to WRITINGS or PRINTING"


def test_a_full_disk(tmp_path: Path, disk: Path, catalogue: str, registry: str) -> None:
    made = tmp_path / "made"
    made.mkdir()
    (made / "catalogue.toml").write_text(catalogue)
    (made / "weights.toml").write_text(registry)
    write_bodies(made / "boxes")
    (made / "body.toml").write_text(f'weights = "{made / "parts"}"\nmotion = "{CLIPS / "kick.bvh"}"\n')
    (made / "rig.bvh").write_text((CLIPS / "kick.bvh").read_text().replace("-42.1546", "-45.5"))  # longer thighs
    ended = subprocess.run(
        [sys.executable, "-m", "tests.full_disk.forked_commands", str(made), str(disk), "empty", "half"],
        cwd=REPOSITORY,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-3000:]
    runs = [json.loads(line) for line in ended.stdout.splitlines()]
    assert len(runs) == len(PREPARED) + 2 * len(WRITINGS) + len(FIRST_FORMS)
    wrong = [run for run in runs if not (_is_made(*run) if run[0] == "made" else _is_right(*run))]
    assert not wrong, "\n".join(map(str, wrong))


def _is_made(_: str, __: str, code: int, told: str, ___: list[str]) -> bool:
    return code == 0


def _is_right(_: str, name: str, code: int, told: str, changed: list[str]) -> bool:
    """Exit code 1, one line that names the way out, and the disk as it was; the part of a download may stay."""
    if name in ("fetched", "fetched-weights") and any(each.endswith(".part") for each in changed):
        changed = [each for each in changed if not each.endswith((name, ".downloads", ".part", ".part.mark"))]
    return (
        code == 1
        and told.count("\n") == 1
        and told.startswith("pumps: ")
        and "Free space on that disk, or " in told
        and not changed
    )
