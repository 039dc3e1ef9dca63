"""Runs the commands of `writing_commands.py` in processes that share their imports, under limits or on a small disk.

    python -m tests.full_disk.forked_commands MADE DISK SITUATION...

Each command runs first without limits, into the folder MADE. Then it runs in each situation into the folder DISK,
where it must fail. If DISK is a file system of its own, it is filled before each command. Otherwise the size of
files is limited. One line of JSON for each run is printed: situation, name, exit code or signal, stderr, and the
files and folders in DISK that are not as they were.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.forked_processes import import_everything
from tests.full_disk.writing_commands import FIRST_FORMS, PREPARED, WRITINGS, Writing

BLOCK = 4096
SECONDS = 300


def main(made: Path, disk: Path, situations: list[str]) -> None:
    """Run everything.

    Args:
        situations: "empty" for nothing free and no old output, with one form of each command; "half" for half
            of what is needed beside an old output, with all forms.
    """
    import_everything()
    gc.freeze()  # the forked processes shall not go through, and so copy, all objects of the imports
    for writing in (WRITINGS[0], *PREPARED, *WRITINGS[1:]):
        out = _prepare(writing, made, made / writing.name)
        print(json.dumps(["made", writing.name, *_run(writing, made, out), []]), flush=True)
    for situation in situations:
        for writing in WRITINGS if situation == "half" else FIRST_FORMS:
            print(json.dumps([situation, writing.name, *_refused(writing, made, disk, situation)]), flush=True)


def _refused(writing: Writing, made: Path, disk: Path, situation: str) -> tuple[int, str, list[str]]:
    """Run a command that has too little room. Returns its exit code, stderr, and what is not as it was before."""
    place = disk / "place"
    place.mkdir()
    out = _prepare(writing, made, place / Path(writing.name).name)
    if situation == "half" and writing.replaces:
        for old in _outputs(writing, made / writing.name):
            if old.is_dir():
                shutil.copytree(old, place / old.name, dirs_exist_ok=True)
            else:
                shutil.copy2(old, place / old.name)
    needed = _largest_file(writing, made)
    room = needed // 2 if situation == "half" else 0
    before = _content(place)
    filled = disk / "filled"
    if os.path.ismount(disk):
        _fill(filled, disk, room)
        code, told = _run(writing, made, out, overwrite=situation == "half")
    else:
        limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))  # noqa: E731
        code, told = _run(writing, made, out, overwrite=situation == "half", before=limit)
    after = _content(place)
    changed = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    filled.unlink(missing_ok=True)
    shutil.rmtree(place)
    return code, told, changed


def _prepare(writing: Writing, made: Path, out: Path) -> Path:
    """What must be there before the command: the page that gets a table, the weights that are calibrated."""
    out.parent.mkdir(parents=True, exist_ok=True)
    if writing.adds_to:
        shutil.copytree(made / writing.adds_to, out)
    elif writing.command == "formats":
        from pumps_cli.commands.formats import BEGIN, END

        out.write_text(f"{BEGIN}\n{END}\n")
    return out


def _outputs(writing: Writing, first: Path) -> Iterator[Path]:
    """The output and those that stand beside it under its name with more at its end."""
    names = {first.name} | {f"{first.name}{more}" for more in (".svg", "-kept") if f"{{out}}{more}" in writing.words}
    yield from (each for each in first.parent.iterdir() if each.name in names)


def _largest_file(writing: Writing, made: Path) -> int:
    """Size in bytes of the largest file that the command writes."""
    outputs = [*_outputs(writing, made / writing.name)]
    if writing.adds_to:  # the one file that the earlier output does not have
        there = {path.name for path in (made / writing.adds_to).iterdir()}
        outputs = [path for each in outputs for path in each.iterdir() if path.name not in there]
    files = [file for each in outputs for file in ([each] if each.is_file() else each.rglob("*")) if file.is_file()]
    return max(file.stat().st_size for file in files)


def _content(place: Path) -> dict[str, bytes | str]:
    """What lies in a folder: the bytes of files, and "a folder" for folders."""
    return {
        str(each.relative_to(place)): each.read_bytes() if each.is_file() else "a folder" for each in place.rglob("*")
    }


def _fill(path: Path, disk: Path, room: int) -> None:
    """Fill the disk so that whole blocks of at most `room` bytes are left."""
    free = shutil.disk_usage(disk).free - room // BLOCK * BLOCK
    with open(path, "wb") as file:
        os.posix_fallocate(file.fileno(), 0, free)


def _run(
    writing: Writing, made: Path, out: Path, *, overwrite: bool = False, before: Callable[[], object] | None = None
) -> tuple[int, str]:
    """Run a command in a process of its own. Returns its exit code, or minus its signal, and its stderr."""
    words = [*writing.command.split(), *(word.format(made=made, out=out) for word in writing.words.split())]
    words += ["--quiet", *(["--overwrite"] if overwrite and writing.asks else [])]
    reading, told = os.pipe()
    process = os.fork()
    if process == 0:
        _become(words, told, before)
    os.close(told)
    with os.fdopen(reading, "rb") as stream:
        text = stream.read().decode(errors="replace")
    _, status = os.waitpid(process, 0)
    return os.waitstatus_to_exitcode(status), text


def _become(words: list[str], told: int, before: Callable[[], object] | None) -> None:
    """In a new process: run the command and end with its exit code."""
    from pumps_cli.app import main as pumps

    code = 255
    try:
        signal.alarm(SECONDS)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(told, 2)
        sys.stdout, sys.stderr = (os.fdopen(number, "w", encoding="utf-8") for number in (1, 2))
        if before is not None:
            before()
        pumps(words)
    except SystemExit as leaving:
        code = int(leaving.code or 0)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
