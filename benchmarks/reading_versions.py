"""Time reading by two checkouts of this project in turn, beside other libraries, and measure the memory it takes.

    python benchmarks/reading_versions.py [ARCHIVE ...] [--base HEAD] [--rounds 3] [--page docs/performance.md]

Without archives it reads the embedded clips, each 40 times; without a base it compares the files as they are with the
last commit.

Each checkout reads in a process of its own; only one of them computes at any time. Rates are megabytes of text for
each CPU second of one process, on the same files. Parsing is `read_bvh` of bytes in memory; the whole way is `pumps
ingest` with one worker. Memory is the peak of a fresh process, above what its imports take, that reads one BVH: all
rows of the archive's BVHs that have the first one's header, up to about 100 MB.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from measuring.checkouts import checked_out
from measuring.section import replace_section
from reading import embedded

from stages.shared.formats.sources import find_sources

HERE = Path(__file__).resolve().parent.parent
SAMPLE_BYTES = 20e6
LONG_BYTES = 100e6
SECTION = "reading versions"
OTHERS = {"upc-pymotion": "pymotion", "pybvh": "pybvh"}  # libraries that are timed where they are installed
# What a process of a checkout or of a library runs: a line of JSON asks for something, a line of JSON answers.
READER = """
import json, os, resource, sys, tempfile, time
from contextlib import redirect_stdout
from pathlib import Path
root, who = sys.argv[1:]
if who == "pumps":
    sys.path.insert(0, root)
    import stages, pyarrow.compute
    assert stages.__path__[0].startswith(root), stages.__path__
    from stages.ingest.config import Config
    from stages.ingest.run import run
    from stages.shared.formats.bvh import read_bvh
    from stages.shared.formats.bvh_motion import motion_of
    files = {}
    def parse(path):
        read_bvh(files.setdefault(path, Path(path).read_bytes()), path)
    def whole(path):
        motion_of(read_bvh(Path(path).read_bytes(), path))
    def ingest(path):
        with tempfile.TemporaryDirectory() as folder:
            run(Config(sources=(path,), output=Path(folder) / "motion", workers=1))
elif who == "upc-pymotion":
    from pymotion.io.bvh import BVH
    def whole(path):
        BVH().load(path)
elif who == "pybvh":
    import pybvh
    def whole(path):
        pybvh.read_bvh_file(path)
def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1e3
answer = sys.stdout
print("ready", flush=True)
for line in sys.stdin:
    what, paths = json.loads(line)
    before, began, seconds, refused = peak(), time.process_time(), 0.0, 0
    for path in paths:
        try:
            with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
                globals()[what](path)
        except Exception:
            if who == "pumps":
                raise
            refused += 1
    print(json.dumps([time.process_time() - began, peak() - before, refused]), file=answer, flush=True)
"""


class Reader:
    """A process in which a checkout or a library reads. Raises SystemExit if it does not start."""

    def __init__(self, root: Path, who: str = "pumps"):
        command = [sys.executable, "-c", READER, str(root.resolve()), who]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.works = self._line() == "ready"
        if not self.works and who == "pumps":
            raise SystemExit(f"{root} could not be loaded; its own words stand above.")

    def _line(self) -> str:
        assert self.process.stdout
        return self.process.stdout.readline().strip()

    def ask(self, what: str, paths: Sequence[Path | str]) -> tuple[float, float, int]:
        """CPU seconds, megabytes by which the peak of memory grew, and files that were refused."""
        assert self.process.stdin
        self.process.stdin.write(json.dumps([what, [str(path) for path in paths]]) + "\n")
        self.process.stdin.flush()
        return tuple(json.loads(self._line()))

    def end(self) -> None:
        self.process.communicate()


def memory(root: Path, path: Path) -> tuple[float, float]:
    """Peaks in MB of a fresh process that parses a BVH, and of one that ingests it."""
    found = []
    for what in ("parse", "ingest"):
        reader = Reader(root)
        found.append(reader.ask(what, [path])[1])
        reader.end()
    return found[0], found[1]


def long_file(archive: str, path: Path) -> float:
    """Write one BVH of the rows of an archive's BVHs that have the same header; returns its megabytes."""
    header, rows, size = "", [], 0
    for source in find_sources([archive]):
        head, _, body = source.read().decode("latin-1").partition("MOTION")
        header = header or head
        if head == header and size < LONG_BYTES:
            rows += [line for line in body.splitlines()[3:] if line.strip()]
            size += len(body)
    lines = [f"{header}MOTION", f"Frames: {len(rows)}", "Frame Time: 0.0333333", *rows, ""]
    path.write_text("\n".join(lines), "latin-1")
    return path.stat().st_size / 1e6


def compared(before: Path, archive: str, folder: Path, rounds: int) -> list[dict[str, Any]]:
    """A row for parsing and one for the whole way of each archive; libraries read the same files to rotations."""
    sources = [source for source in find_sources([archive]) if source.suffix == ".bvh"]
    every = max(1, int(sum(source.size for source in sources) / SAMPLE_BYTES))
    paths = []
    for number, source in enumerate(sources[::every]):
        paths.append(folder / f"{Path(archive).stem}-{number}.bvh")
        paths[-1].write_bytes(source.read().rstrip() + b"\n")  # upc-pymotion stumbles over a blank last line
    sample = sum(path.stat().st_size for path in paths) / 1e6
    readers = {"before": Reader(before), "after": Reader(HERE)}
    readers |= {who: Reader(HERE, who) for who, module in OTHERS.items() if find_spec(module) is not None}
    asked: dict[str, tuple[str, list[Any], float]] = {
        "parsing": ("parse", paths, sample),
        "to poses": ("whole", paths, sample),
        "whole `ingest`": ("ingest", [archive], sum(source.size for source in find_sources([archive])) / 1e6),
    }
    rows = []
    for name, (what, given, megabytes) in asked.items():
        times: dict[str, list[float]] = {}
        for _ in range(rounds):
            for who, reader in readers.items():
                if reader.works and (what == "whole" or who in ("before", "after")):
                    seconds, _, refused = reader.ask(what, given)
                    times.setdefault(who, []).append(seconds if not refused else float("nan"))
        rates = {who: megabytes / min(found) for who, found in times.items()}
        medians = [statistics.median(times[who]) for who in ("before", "after")]
        rows.append({"what": f"{Path(archive).name}, {name}", "rates": rates, "medians": medians[0] / medians[1]})
        print(rows[-1], file=sys.stderr)
    for reader in readers.values():
        reader.end()
    return rows


def table(rows: Sequence[dict[str, Any]], peaks: Sequence[tuple[str, float, float]], size: float) -> str:
    """The page's section."""
    names = ["before", "after", *OTHERS]
    lines = ["| MB/s of a core, best of the rounds | " + " | ".join(names) + " | ratio | ratio of medians |"]
    lines.append("|---|" + "---:|" * (len(names) + 2))
    for row in rows:
        rates = row["rates"]
        cells = ["" if name not in rates else f"{rates[name]:.0f}" for name in names]
        cells = [cell if cell != "nan" else "refused" for cell in cells]
        cells += [f"{rates['after'] / rates['before']:.2f}", f"{row['medians']:.2f}"]
        lines.append(f"| {row['what']} | " + " | ".join(cells) + " |")
    lines += ["", f"| peak memory of one BVH of {size:.0f} MB, MB | before | after |", "|---|---:|---:|"]
    lines += [f"| {name} | {old:.0f} | {new:.0f} |" for name, old, new in peaks]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*")
    parser.add_argument("--base", default="HEAD", help="the commit to compare with")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--page", type=Path, help="a page whose section is to be replaced")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, checked_out(options.base) as before:
        folder = Path(name)
        archives = options.archives or [embedded(folder)]
        rows = []
        for archive in archives:
            rows += compared(before, archive, folder, options.rounds)
        size = long_file(archives[-1], folder / "long.bvh")
        old, new = (memory(root, folder / "long.bvh") for root in (before, HERE))
    peaks = [("parsing, the text included", old[0], new[0]), ("whole `ingest`, one worker", old[1], new[1])]
    text = table(rows, peaks, size)
    if options.page:
        replace_section(options.page, SECTION, text)
    print(text)


if __name__ == "__main__":
    main()
