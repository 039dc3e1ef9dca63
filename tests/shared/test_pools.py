"""Work handed to a Dask cluster: the same bytes as without, nothing lost or twice where a worker is killed."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from data_schemas.artefact import open_artefact
from data_schemas.errors import UsageError
from stages.edit.mirror.config import Config as MirrorConfig
from stages.edit.mirror.run import run as mirror
from stages.encode.config import Config as EncodeConfig
from stages.encode.run import run as encode
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample_tpc
from stages.shared.many_files.file_runs import JOURNAL, TABLE
from stages.shared.pools import cluster_pool
from stages.shared.weights.shipped import SHIPPED

pytest.importorskip("distributed")
CLIPS = [Path(f"stages/shared/clips/{name}.bvh").resolve() for name in ("jump", "kick", "punch", "run", "walk")]
START_S = 60


class Cluster:
    """A scheduler and workers without nannies, so that a killed worker does not come back."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._file = folder, folder / "scheduler.json"
        environment = {**os.environ, "DASK_DISTRIBUTED__DASHBOARD__LINK": ""}
        self._start = lambda *words: subprocess.Popen(
            [sys.executable, "-m", "dask", *words], cwd=folder, env=environment,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        file = str(self._file)
        self._scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file
        )
        self.workers = [self._worker(), self._worker()]
        self._wait_for(self._file.exists)
        self.address = json.loads(self._file.read_text())["address"]

    def _worker(self) -> subprocess.Popen:
        file = str(self._file)
        words = ("--scheduler-file", file, "--no-nanny", "--no-dashboard", "--nthreads", "1", "--death-timeout", "60")
        return self._start("worker", *words, "--local-directory", str(self._folder))

    def kill_a_worker(self) -> None:
        worker = self.workers.pop(0)
        worker.send_signal(signal.SIGKILL)
        worker.wait()

    def have_two_workers(self) -> None:
        while len(self.workers) < 2:
            self.workers.append(self._worker())
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            self._wait_for(lambda: len(client.scheduler_info()["workers"]) == 2)

    def _wait_for(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + START_S
        while not condition():
            assert time.monotonic() < end, "the cluster did not start"
            time.sleep(0.05)

    def close(self) -> None:
        for process in (*self.workers, self._scheduler):
            process.kill()
            process.wait()


class KillsAWorker:
    """A progress display that kills a worker when the first item is done."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster, self.killed = cluster, False

    def start(self, *_: object, **__: object) -> None: ...

    def advance(self, *_: object, **__: object) -> None:
        if not self.killed:
            self.killed = True
            self._cluster.kill_a_worker()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    # Workers have PYTHONPATH, or an installed pumps, from this process.
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.close()


def test_artefacts_are_the_same_and_a_worker_may_die_in_the_middle(cluster: Cluster, tmp_path: Path):
    cluster.have_two_workers()
    digests = {}
    for name, address in (("here", None), ("cluster", cluster.address)):
        folder = tmp_path / name
        killer = KillsAWorker(cluster)
        killer.killed = address is None  # without a cluster, no worker is killed
        ingest(IngestConfig(sources=tuple(map(str, CLIPS)), output=folder / "motion", cluster=address))
        sample_tpc(SampleConfig(motion=folder / "motion", output=folder / "tpc", points=64, cluster=address))
        encode(
            EncodeConfig(tpc=folder / "tpc", ae=SHIPPED / "small-free/ae", output=folder / "latent", cluster=address),
            progress=killer,
        )
        digests[name] = [open_artefact(folder / each).manifest.digest for each in ("motion", "tpc", "latent")]
        assert killer.killed
    assert digests["here"] == digests["cluster"]


def test_files_are_the_same_with_each_once_where_a_worker_dies_in_the_middle(cluster: Cluster, tmp_path: Path):
    cluster.have_two_workers()
    clips = tmp_path / "in"
    clips.mkdir()
    for path in CLIPS:
        shutil.copy(path, clips)
    (clips / "bad.bvh").write_text("HIERARCHY\nROOT a\n{\n")
    mirror(MirrorConfig(input=clips, output=tmp_path / "here", jobs=1))
    killer = KillsAWorker(cluster)
    mirror(MirrorConfig(input=clips, output=tmp_path / "there", cluster=cluster.address), progress=killer)
    assert killer.killed and len(cluster.workers) == 1
    here, there = (
        {path.name: path.read_bytes() for path in (tmp_path / to).glob("*.bvh")} for to in ("here", "there")
    )
    assert here == there and len(here) == len(CLIPS)
    with open(tmp_path / "there" / TABLE, newline="") as file:
        rows = list(csv.DictReader(file))
    assert sorted(Path(row["input"]).name for row in rows) == sorted(path.name for path in clips.iterdir())
    assert [row["input"] for row in rows if row["status"] == "failed"] == [str(clips / "bad.bvh")]
    assert len((tmp_path / "there" / JOURNAL).read_bytes().splitlines()) == 1 + len(rows)


def test_what_a_task_raises_is_raised_here(cluster: Cluster):
    with cluster_pool(cluster.address) as pool, pytest.raises(ZeroDivisionError):
        pool.submit(divmod, 1, 0).result()


def test_an_address_without_a_scheduler_is_one_sentence(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("stages.shared.pools._CONNECT_S", 1)
    with pytest.raises(UsageError, match="No Dask scheduler is found"), cluster_pool("tcp://127.0.0.1:1"):
        pass
