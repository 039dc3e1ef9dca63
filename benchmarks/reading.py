"""Time reading motion files: unpacking, number parsing, poses, and the whole way into a motion artefact.

    python benchmarks/reading.py [ARCHIVE.zip ...] [--json]

Without archives it reads the embedded clips, many times over. Parts are in megabytes of text per second of one core's
CPU time, the whole way in megabytes per second of wall time with all cores; upc-pymotion reads beside if installed.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

from stages.formats.bvh import read_bvh
from stages.formats.bvh_motion import motion_of
from stages.formats.sources import Source, find_sources
from stages.ingest.config import Config
from stages.ingest.run import run

SAMPLE_BYTES = 40e6


def rate(work: Callable[[], object], megabytes: float) -> float:
    """Megabytes for each second of CPU time of this process."""
    began = time.process_time()
    work()
    return megabytes / max(time.process_time() - began, 1e-9)


def parts(sources: Sequence[Source]) -> dict[str, float]:
    """Rates of each step alone, on about 40 MB."""
    every = max(1, int(sum(source.size for source in sources) / SAMPLE_BYTES))
    some = sources[::every]
    megabytes = sum(source.size for source in some) / 1e6
    texts: list[bytes] = []
    figures = {"unpacking": rate(lambda: texts.extend(source.read() for source in some), megabytes)}
    files = []
    figures["parsing"] = rate(lambda: files.extend(read_bvh(text, "clip") for text in texts), megabytes)
    figures["poses"] = rate(lambda: [motion_of(file, trim_first="auto") for file in files], megabytes)
    try:
        from pymotion.io.bvh import BVH
    except ImportError:
        return figures
    with tempfile.TemporaryDirectory() as folder:
        few = texts[:: max(1, len(texts) // 20)]
        paths = [Path(folder) / f"{i}.bvh" for i in range(len(few))]
        for path, text in zip(paths, few, strict=True):
            path.write_bytes(text.rstrip() + b"\n")
        size = sum(path.stat().st_size for path in paths) / 1e6
        figures["upc-pymotion"] = rate(lambda: [BVH().load(str(path)) for path in paths], size)
    return figures


def whole_way(archive: str, megabytes: float) -> float:
    """Megabytes of text per second of wall time, from the archive into the artefact."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        run(Config(sources=(archive,), output=Path(folder) / "motion"))
        return megabytes / (time.perf_counter() - began)


def embedded(folder: Path) -> str:
    """An archive of the embedded clips, each 40 times."""
    path = folder / "clips.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for clip in sorted((Path(__file__).parents[1] / "stages" / "clips").glob("*.bvh")):
            for copy in range(40):
                archive.write(clip, f"{clip.stem}-{copy}.bvh")
    return str(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for archive in arguments.archives or [embedded(Path(folder))]:
            sources = find_sources([archive])
            megabytes = sum(source.size for source in sources) / 1e6
            figures = parts(sources) | {"whole way": whole_way(archive, megabytes)}
            if arguments.json:
                print(json.dumps({"archive": Path(archive).name, "megabytes": megabytes} | figures))
                continue
            print(f"{Path(archive).name}: {len(sources)} files, {megabytes:.0f} MB")
            for name, value in figures.items():
                print(f"  {name:<14}{value:7.1f} MB/s")


if __name__ == "__main__":
    main()
