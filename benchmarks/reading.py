"""Time reading motion files: step by step, beside other libraries, into an artefact, and windows out of it.

    python benchmarks/reading.py [ARCHIVE ...] [--json] [--page docs/performance.md]

Without archives it reads the embedded clips, many times over. Steps and other libraries are in megabytes of text for
each second of one core's CPU time, on the same files in the same run; the whole way is in wall time with all cores,
and in CPU time with one worker. A step's limit is the time in which what it reads and writes, once, could be copied
in main memory.
A file that a library cannot read counts against nobody: it is left out for all and counted. Libraries that are not
installed are left out (`pip install -e '.[dev,bench]'` brings them).
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import torch
from measuring.machine import limits
from measuring.section import replace_section

from data_schemas.content_digest import content_digest
from data_schemas.errors import PumpsError
from data_schemas.motion import ClipRow, MotionReader, MotionWriter
from data_schemas.skeleton import Motion, Skeleton
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.sources import Source, find_sources
from stages.shared.humanoid.motion_quality import measure_quality
from stages.shared.kinematics.forward_numpy import positions_of

SAMPLE_BYTES = 40e6
COMPARED_BYTES = 5e6  # of text, for libraries that take long
WINDOW = 128
WINDOW_SECONDS = 3.0
HOURS_FPS = 30.0
SECTION = "bench-ingest"


def steps(sources: Sequence[Source]) -> tuple[dict[str, float], dict[str, float]]:
    """MB/s of each step alone, on about 40 MB; and the share of its limit that each reaches."""
    every = max(1, int(sum(source.size for source in sources) / SAMPLE_BYTES))
    some = sources[::every]
    megabytes = sum(source.size for source in some) / 1e6
    texts: list[bytes] = []
    files: list[Any] = []
    figures: list[Any] = []
    rates = {"unpacking": _rate(lambda: texts.extend(source.read() for source in some), megabytes)}
    rates["parsing"] = _rate(lambda: files.extend(read_bvh(text, "clip") for text in texts), megabytes)
    rates["poses"] = _rate(lambda: figures.extend(motion_of(file, trim_first="auto") for file in files), megabytes)
    rates["quality"] = _rate(lambda: [measure_quality(s, m, positions_of(s, m)) for s, m, _ in figures], megabytes)
    with tempfile.TemporaryDirectory() as folder:
        rates["writing"] = _rate(lambda: write(figures, Path(folder)), megabytes)
        stored = Path(folder) / MotionWriter.FILE
        rates["digests"] = _rate(lambda: content_digest(stored, "motion"), megabytes)
        written = stored.stat().st_size / 1e6
    numbers = sum(file.values.nbytes for file in files) / 1e6
    motions = sum(m.rotations.nbytes + m.root_positions.nbytes + m.tracks.nbytes for _, m, _ in figures) / 1e6
    moved = {
        "unpacking": megabytes,
        "parsing": megabytes + numbers,
        "poses": numbers + motions,
        "quality": motions,
        "writing": motions + written,
        "digests": written,
    }
    copied = 1e3 * limits(torch.device("cpu"))["memory_gb_per_s"]()  # MB/s
    return rates, {name: moved[name] * rate / megabytes / copied for name, rate in rates.items()}


def write(figures: Sequence[tuple[Skeleton, Motion, list[str]]], folder: Path) -> None:
    """Write skeletons and motions as `ingest` does."""
    with MotionWriter(folder) as writer:
        for number, (skeleton, motion, _) in enumerate(figures):
            name, seconds = writer.add_skeleton(skeleton), motion.frames / motion.fps
            row = ClipRow(str(number), "clip", "", name, motion.frames, motion.fps, seconds, "train", "none")
            writer.add_clip(row, motion)


def _rate(work: Callable[[], object], megabytes: float) -> float:
    """Megabytes for each second of CPU time of this process."""
    began = time.process_time()
    work()
    return megabytes / max(time.process_time() - began, 1e-9)


def compared(sources: Sequence[Source]) -> tuple[dict[str, float], dict[str, int]]:
    """MB/s of reading a file whole, to joint rotations at least, ours and others'; and files each could not read."""
    every = max(1, int(sum(source.size for source in sources) / COMPARED_BYTES))
    texts = [source.read() for source in sources[::every]]
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{i}.bvh" for i in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_bytes(text.rstrip() + b"\n")  # upc-pymotion stumbles over a blank last line
        rates, refused = {}, {}
        for name, read in _readers():
            good, seconds, failed = 0, 0.0, 0
            for path in paths:
                began = time.process_time()
                try:
                    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
                        read(path)
                except Exception:  # whatever another library raises
                    failed += 1
                    continue
                seconds += time.process_time() - began
                good += path.stat().st_size
            refused[name] = failed
            rates[name] = good / 1e6 / max(seconds, 1e-9) if good else 0.0
    return rates, refused


def _readers() -> Iterator[tuple[str, Callable[[Path], object]]]:
    yield "pumps", lambda path: motion_of(read_bvh(path.read_bytes(), path.name))
    try:
        from pymotion.io.bvh import BVH

        yield "upc-pymotion", lambda path: BVH().load(str(path))
    except ImportError:
        pass
    try:
        import pybvh

        yield "pybvh", lambda path: pybvh.read_bvh_file(str(path))
    except ImportError:
        pass
    try:
        import bvhio

        yield "bvhio", lambda path: bvhio.readAsBvh(str(path))
    except ImportError:
        pass


def whole_way(archive: str, folder: Path) -> tuple[float, Path]:
    """Seconds of wall time from the archive into the artefact on all cores, and the artefact."""
    began = time.perf_counter()
    run(Config(sources=(archive,), output=folder / "motion"))
    return time.perf_counter() - began, folder / "motion"


def one_worker(archive: str, folder: Path) -> float:
    """Seconds of CPU time from the archive into the artefact by one process."""
    began = time.process_time()
    run(Config(sources=(archive,), output=folder / "alone", workers=1))
    return time.process_time() - began


def windows_a_minute(artefact: Path) -> float:
    """Random windows of 128 frames (shorter clips whole) read from the artefact by one process, a minute."""
    rng = np.random.default_rng(0)
    with MotionReader(artefact) as reader:
        count, began = 0, time.perf_counter()
        while time.perf_counter() - began < WINDOW_SECONDS:
            row = reader.clips[int(rng.integers(len(reader.clips)))]
            start = int(rng.integers(max(row.frames - WINDOW, 0) + 1))
            reader.motion(row.clip, start, min(start + WINDOW, row.frames))
            count += 1
        return 60 * count / (time.perf_counter() - began)


def measure(archive: str) -> dict[str, Any]:
    """All figures of one archive."""
    sources = [source for source in find_sources([archive]) if source.name.lower().endswith(".bvh")]
    megabytes = sum(source.size for source in sources) / 1e6
    rates, refused = compared(sources)
    step_rates, reached = steps(sources)
    with tempfile.TemporaryDirectory() as folder:
        seconds, artefact = whole_way(archive, Path(folder))
        alone = one_worker(archive, Path(folder))
        with MotionReader(artefact) as reader:
            recorded = sum(row.seconds for row in reader.clips)
            frames = sum(row.frames for row in reader.clips)
        size = sum(path.stat().st_size for path in artefact.rglob("*") if path.is_file()) / 1e6
        return {
            "archive": Path(archive).name,
            "files": len(sources),
            "megabytes": megabytes,
            "steps": step_rates,
            "reached": reached,
            "compared": rates,
            "refused": refused,
            "seconds": seconds,
            "alone_seconds": alone,
            "frames": frames,
            "hours": recorded / 3600,
            "artefact_megabytes": size,
            "windows_a_minute": windows_a_minute(artefact),
            "peak_megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        }


def table(measured: Sequence[dict[str, Any]]) -> str:
    """The page's section."""
    head = [
        "archive",
        "BVH text",
        "seconds, all cores",
        "MB/s",
        "MB/s, one worker",
        "recorded hours",
        "100 hours of it, one worker",
        "artefact",
        "windows a minute",
    ]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for each in measured:
        hundred = each["alone_seconds"] * 100 / each["hours"] / 60
        lines.append(
            f"| {each['archive']}, {each['files']} files | {each['megabytes']:.0f} MB | {each['seconds']:.1f} | "
            f"{each['megabytes'] / each['seconds']:.0f} | {each['megabytes'] / each['alone_seconds']:.0f} | "
            f"{each['hours']:.2f} | {hundred:.0f} min | "
            f"{each['artefact_megabytes']:.0f} MB | {each['windows_a_minute']:,.0f} |"
        )
    lines += ["", "Megabytes of text for each second of one core:", ""]
    names = list(measured[0]["steps"])
    lines += ["| archive | " + " | ".join(names) + " |", "|---|" + "---:|" * len(names)]
    lines += [
        "| " + " | ".join([each["archive"], *(f"{each['steps'][n]:.0f}" for n in names)]) + " |" for each in measured
    ]
    lines += ["", "Shares of the steps in their sum:", ""]
    lines += ["| archive | " + " | ".join(names) + " |", "|---|" + "---:|" * len(names)]
    for each in measured:
        costs = {name: 1 / each["steps"][name] for name in names}
        cells = [f"{100 * cost / sum(costs.values()):.0f} %" for cost in costs.values()]
        lines.append("| " + " | ".join([each["archive"], *cells]) + " |")
    lines += ["", "Shares of their limits that the steps reach (bytes read and written once, as fast as a copy):", ""]
    lines += ["| archive | " + " | ".join(names) + " |", "|---|" + "---:|" * len(names)]
    for each in measured:
        cells = [f"{100 * each['reached'][name]:.1f} %" for name in names]
        lines.append("| " + " | ".join([each["archive"], *cells]) + " |")
    others = list(measured[0]["compared"])
    lines += ["", "The same files read whole, by libraries; in brackets how many of them each refused:", ""]
    lines += ["| archive | " + " | ".join(others) + " |", "|---|" + "---:|" * len(others)]
    for each in measured:
        cells = [f"{each['compared'][n]:.1f} ({each['refused'][n]})" for n in others]
        lines.append("| " + " | ".join([each["archive"], *cells]) + " |")
    peak = max(each["peak_megabytes"] for each in measured)
    lines += [
        "",
        f"Peak memory of the writing process: {peak:.0f} MB. 100 hours are extrapolated from the archive's rate, in "
        "CPU time.",
    ]
    return "\n".join(lines)


def embedded(folder: Path) -> str:
    """An archive of the embedded clips, each 40 times."""
    path = folder / "clips.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for clip in sorted((Path(__file__).parents[1] / "stages" / "shared" / "clips").glob("*.bvh")):
            for copy in range(40):
                archive.write(clip, f"{clip.stem}-{copy}.bvh")
    return str(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*")
    parser.add_argument("--json", action="store_true", help="one line of numbers")
    parser.add_argument("--page", type=Path, help="a page whose section is to be replaced")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        try:
            measured = [measure(archive) for archive in options.archives or [embedded(Path(folder))]]
        except PumpsError as error:
            raise SystemExit(str(error)) from None
    if options.page:
        replace_section(options.page, SECTION, table(measured))
    print(json.dumps(measured) if options.json else table(measured))


if __name__ == "__main__":
    main()
