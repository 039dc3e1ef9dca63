"""What 10, 1,000 and 100,000 hours of motion take: seconds of cores, disk, and what one process must do alone.

    python benchmarks/scale.py SOURCE [--where EXPRESSION] [--weights NAME] [--page docs/scale.md]

SOURCE is read by `pumps ingest`. All stages run on a Dask cluster of one worker on this machine. Seconds are those
of the processor, so that other work on the machine hardly counts: of the worker, and of the process that gives the
command (which hands out clips and writes the artefact). The scheduler has a process of its own, which is not
counted. `infill` fills the clips that come with pumps, a key every 15 frames. The first table has all figures divided
by the hours of motion, and the second one multiplies them.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from distributed import Client
from distributed.deploy.subprocess import SubprocessCluster
from measuring.section import replace_section

from data_schemas.clips import read_clips
from data_schemas.manifest import open_artefact
from stages.encode.config import Config as EncodeConfig
from stages.encode.run import run as encode
from stages.infill.config import Config as InfillConfig
from stages.infill.run import run as infill
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample_tpc
from stages.shared.weights.shipped import default_weights, parts_of, weights_folder

MARK = "scale"
CLIPS = Path(__file__).resolve().parents[1] / "stages/shared/clips"
HOURS = (10, 1_000, 100_000)
WORKERS = (1, 16, 1_000)


@dataclass(frozen=True)
class Cost:
    """Of one hour of motion: processor seconds of workers and of the command itself, and bytes on disk."""

    stage: str
    workers_s: float
    alone_s: float
    stored: float

    def seconds(self, hours: float, workers: int) -> float:
        """For so many hours of motion: those of the workers or of the command's process, whichever takes longer."""
        return hours * max(self.workers_s / workers, self.alone_s)


def cost_of(stage: str, client: Client, hours: Callable[[], float], output: Path, run: Callable[[], object]) -> Cost:
    """Run a stage and measure it; `hours` of motion are known afterwards."""

    def worker_s() -> float:
        return sum(client.run(time.process_time).values())

    before, own = worker_s(), time.process_time()
    run()
    own_after = time.process_time()
    spent = worker_s() - before
    stored = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    return Cost(stage, spent / hours(), (own_after - own) / hours(), stored / hours())


def measure(source: str, where: str | None, weights: str) -> tuple[list[Cost], float]:
    """The costs of all stages, and the hours of motion that were read."""
    ae = parts_of(weights_folder(weights))[0]
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        with (
            SubprocessCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):
            at = cluster.scheduler_address

            def hours_in(name: str) -> Callable[[], float]:
                return lambda: _seconds_in(folder / name) / 3600

            ingested = IngestConfig(sources=(source,), output=folder / "motion", cluster=at)
            sampled = SampleConfig(motion=folder / "motion", output=folder / "tpc", where=where, cluster=at)
            encoded = EncodeConfig(tpc=folder / "tpc", ae=ae, output=folder / "latent", device="cpu", cluster=at)
            clips = folder / "clips"
            shutil.copytree(CLIPS, clips, ignore=shutil.ignore_patterns("*.py", "*.json", "__pycache__"))
            filled = InfillConfig(
                input=clips, output=folder / "filled", keyframes="every:15", weights=weights, cluster=at
            )
            client.run(_warm_up, weights)
            costs = [
                cost_of("ingest", client, hours_in("motion"), folder / "motion", lambda: ingest(ingested)),
                cost_of("sample-tpc", client, hours_in("tpc"), folder / "tpc", lambda: sample_tpc(sampled)),
                cost_of("encode", client, hours_in("tpc"), folder / "latent", lambda: encode(encoded)),
            ]
            ours = IngestConfig(sources=(str(clips),), output=folder / "ours")
            ingest(ours)
            costs.append(cost_of("infill", client, hours_in("ours"), folder / "filled", lambda: infill(filled)))
        return costs, _seconds_in(folder / "motion") / 3600


def _warm_up(weights: str) -> None:
    """On the worker: load what every run loads once."""
    from stages.shared.inference.kept_models import kept_models

    kept_models(weights, "cpu")


def _seconds_in(artefact: Path) -> float:
    return sum(row.seconds for row in read_clips(open_artefact(artefact).folder))


def tables(costs: list[Cost], hours: float, source: str) -> str:
    """Two tables in markdown: what an hour of motion costs, and what many cost."""
    lines = [
        f"Measured on {hours * 60:.1f} minutes of motion ({Path(source).name}); `infill` on the clips that come with "
        "pumps.",
        "",
        "| stage | workers, s | the command itself, s | disk, MB | workers that one command keeps busy |",
        "|---|---:|---:|---:|---:|",
    ]
    lines += [
        f"| `{c.stage}` | {c.workers_s:,.1f} | {c.alone_s:.2f} | {c.stored / 1e6:,.1f} | "
        f"{c.workers_s / max(c.alone_s, 1e-9):,.0f} |"
        for c in costs
    ]
    lines += [
        "",
        "| hours of motion | stage | disk | " + " | ".join(map(_workers, WORKERS)) + " |",
        "|---:|---|---:|" + "---:|" * len(WORKERS),
    ]
    for amount in HOURS:
        for c in costs:
            times = " | ".join(_duration(c.seconds(amount, count)) for count in WORKERS)
            lines.append(f"| {amount:,} | `{c.stage}` | {_size(amount * c.stored)} | {times} |")
    return "\n".join(lines)


def _workers(count: int) -> str:
    return f"{count:,} worker" if count == 1 else f"{count:,} workers"


def _duration(seconds: float) -> str:
    for unit, length in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:,.1f} {unit}"
    return f"{seconds:.0f} s"


def _size(count: float) -> str:
    for unit, length in (("TB", 1e12), ("GB", 1e9)):
        if count >= length:
            return f"{count / length:,.1f} {unit}"
    return f"{count / 1e6:,.0f} MB"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", help="an archive or folder of recordings")
    parser.add_argument("--where", help="clips to use after ingest, as of `pumps sample-tpc`")
    parser.add_argument("--weights", default=default_weights())
    parser.add_argument("--page", type=Path, help="page whose section gets the tables")
    given = parser.parse_args()
    text = tables(*measure(given.source, given.where, given.weights), given.source)
    print(text)
    if given.page:
        replace_section(given.page, MARK, text)


if __name__ == "__main__":
    main()
