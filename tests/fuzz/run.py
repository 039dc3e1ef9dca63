"""Coverage-guided fuzzing of the readers by atheris: `make fuzz`, or

    python -m tests.fuzz.run --minutes 1 [TARGET ...]

Each target of `tests.fuzz.targets` runs in a process of its own, for so many minutes, from a corpus that the target
writes itself (runs/fuzz/TARGET; what is found on the way is added, and used the next time). An input that breaks
something is kept as runs/fuzz/TARGET-crash-..., and `python -m tests.fuzz.run --again FILE TARGET` runs it alone.
Exit status 1 if any target found something.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

LONGEST_S, MOST_MB, LONGEST_INPUT = 10, 2048, 32_768


def main() -> int:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    arguments.add_argument("targets", nargs="*", help="all of them if none is named")
    arguments.add_argument("--minutes", type=float, default=1.0, help="for each target")
    arguments.add_argument("--folder", type=Path, default=Path("runs/fuzz"), help="of corpora and finds")
    arguments.add_argument("--again", type=Path, help="an input to run once more, on the one target that is named")
    arguments.add_argument("--one", action="store_true", help=argparse.SUPPRESS)  # the process of one target
    given = arguments.parse_args()
    if given.again:
        return _once(given.targets[0], given.again)
    if given.one:
        return _fuzz(given.targets[0], given.folder, given.minutes)
    from tests.fuzz.targets import FUZZ_TARGETS

    unknown = [name for name in given.targets if name not in FUZZ_TARGETS]
    if unknown:
        arguments.error(f"there is no target {unknown[0]}; there are {', '.join(FUZZ_TARGETS)}")
    found = []
    for name in given.targets or FUZZ_TARGETS:
        command = [sys.executable, "-m", "tests.fuzz.run", "--one", "--minutes", str(given.minutes)]
        print(f"== {name}", flush=True)
        if subprocess.run([*command, "--folder", str(given.folder), name]).returncode:
            found.append(name)
    print(f"found something in: {', '.join(found)}" if found else "found nothing", flush=True)
    return 1 if found else 0


def _once(name: str, file: Path) -> int:
    from tests.fuzz.targets import FUZZ_TARGETS

    FUZZ_TARGETS[name].run(file.read_bytes())
    print("nothing breaks")
    return 0


def _fuzz(name: str, folder: Path, minutes: float) -> int:
    try:
        import atheris
    except ModuleNotFoundError:
        print("atheris is not installed; install it with: pip install -e '.[fuzz]'", file=sys.stderr)
        return 2
    import torch  # loaded before tracing begins, since its own code is of no interest
    from scipy.spatial import transform

    assert torch and transform
    with atheris.instrument_imports(include=["stages.shared.formats", "stages.shared.toml", "data_schemas"]):
        from tests.fuzz.targets import FUZZ_TARGETS, dictionary_of
    target = FUZZ_TARGETS[name]
    corpus = folder / name
    corpus.mkdir(parents=True, exist_ok=True)
    for at, seed in enumerate(target.seeds()):
        (corpus / f"seed-{at}").write_bytes(seed)
        target.run(seed)  # what loads or compiles on its first use counts against no input
    flags = [
        f"-max_total_time={int(60 * minutes)}", f"-timeout={LONGEST_S}", f"-rss_limit_mb={MOST_MB}",
        f"-max_len={LONGEST_INPUT}", f"-artifact_prefix={folder / name}-", "-print_final_stats=1",
        "-verbosity=0",
    ]  # fmt: skip
    if target.words:  # libFuzzer refuses an empty dictionary
        words = folder / f"{name}.dict"
        words.write_text(dictionary_of(target.words))
        flags.append(f"-dict={words}")
    atheris.Setup([sys.argv[0], *flags, str(corpus)], target.run)
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())
