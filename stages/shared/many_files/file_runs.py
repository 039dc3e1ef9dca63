"""A stage over many files: those of a folder, glob or archive, in several processes, in a run that can be resumed.

The output is a folder. `files.jsonl` in it is the run's journal: its first line has the settings and every output
that is planned, and each file adds a line when it is done. After a kill, the same command goes on: files whose line
says that they were written, whose input is unchanged and whose output exists are not run again. `files.csv` is the
table of what became of each file.
"""

from __future__ import annotations

import csv
import functools
import glob
import hashlib
import io
import json
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.manifest import MANIFEST_NAME
from data_schemas.whole_file import write_whole
from stages.shared.contract import ManyFilesConfig, StageReport
from stages.shared.file_names import FileNames, folded
from stages.shared.formats.archives import archive_and_member, archive_suffix
from stages.shared.formats.readers import AUTO, suffixes_of
from stages.shared.formats.sources import Source, find_sources
from stages.shared.formats.text_cells import text_cell
from stages.shared.formats.writers import SUFFIXES
from stages.shared.outputs import check_replaceable
from stages.shared.pools import TaskDied, cluster_pool, process_pool, result_or_death
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.tables import counted
from stages.shared.threads import cores

JOURNAL, TABLE = "files.jsonl", "files.csv"
COLUMNS: tuple[str, ...] = ("input", "output", "status", "seconds", "frames", "reason", "sha256")
_SPLITS = "splits.json"  # what `pumps ingest` reads beside recordings
_SHOWN = 10
WRITTEN, FAILED, DIED = "written", "failed", "died"  # what became of a file; DIED: its process was ended
_WRITABLE = tuple(SUFFIXES.values())

Run = Callable[..., StageReport]


@dataclass(frozen=True)
class FileRun:
    """One file to run: its source, where its output goes, and the files that are written for that output."""

    source: Source
    output: Path
    files: tuple[Path, ...]


def over_files(run: Run) -> Run:
    """The same run, which also takes a folder, glob or archive as its config's `input` and a folder as `output`."""

    @functools.wraps(run)
    def either(config: Any, *, progress: Progress = SILENT) -> StageReport:
        if names_many(str(config.input)):
            return run_over_files(config, either, progress)
        return run(config, progress=progress)

    return either


def names_many(text: str) -> bool:
    """Whether a text names a folder that is no artefact, an archive as a whole, or a pattern."""
    path = Path(text)
    if path.is_dir():
        return not (path / MANIFEST_NAME).exists()
    if path.exists():
        return bool(archive_suffix(path.name))
    return glob.has_magic(text) and not archive_and_member(text)[0]


def run_over_files(config: Any, run: Run, progress: Progress) -> StageReport:
    """Run a stage for each file of `config.input`. A file that fails is reported, and the others go on.

    Args:
        config: a ManyFilesConfig with `input` and `output`. run: picklable by its name.

    Raises: UsageError for an output that is no folder, or holds files that may not be replaced; InputError where
        there is no file to read, or every one failed.
    """
    started = time.perf_counter()
    out = Path(config.output)
    if out.suffix.lower() in {*_WRITABLE, config.suffix_of(".bvh", _WRITABLE)} or (out.exists() and not out.is_dir()):
        raise UsageError(f"{config.input} holds several files, and {out} is one file.", "Name a folder to write to.")
    digest = _digest_of(config)
    earlier = _earlier(out, digest)
    runs = list(_planned(config, out, earlier.outputs))
    if not runs:
        raise InputError(f"{config.input} holds no file to read.", "docs/formats.md lists the formats.")
    read = {Path(each.source.archive or each.source.name).resolve() for each in runs}
    for file in (file for each in runs for file in each.files):
        if file.resolve() in read:
            raise UsageError(
                f"{file} is one of the files that are read, and must not be replaced.", "Name another folder."
            )
        if not (earlier.same and str(file.relative_to(out)) in earlier.outputs):
            check_replaceable(file, config.overwrite)
    rows = [] if config.overwrite else [row for each in runs if (row := _still_there(earlier.done, each, out))]
    have = {row["input"] for row in rows}
    to_do = [each for each in runs if each.source.name not in have]
    progress.start("files", len(runs))
    progress.advance(len(rows))
    write_whole(out / JOURNAL, _journal_head(digest, runs, out) + b"".join(_line(row) for row in rows))
    with open(out / JOURNAL, "ab") as journal:
        for row in _outcomes(config, run, to_do, out):
            rows.append(row)
            journal.write(_line(row))
            journal.flush()
            progress.advance(note=row["input"])
    order = {each.source.name: at for at, each in enumerate(runs)}
    rows.sort(key=lambda row: order[row["input"]])
    write_whole(out / TABLE, _table(rows, (*COLUMNS, *config.table_columns)))
    return _report(out, rows, len(have), time.perf_counter() - started)


def _planned(config: ManyFilesConfig, out: Path, earlier: frozenset[str]) -> Iterator[FileRun]:
    """Every file with its output, in the same sub-folders, with the suffix to write.

    Where a file would be written for two inputs, the second one's output keeps its input's suffix in its name too.
    What earlier runs wrote into the folder is no input, and neither is a list of splits.
    """
    names: dict[str, FileNames] = {}
    taken: set[str] = set()  # folded, since paths that differ by case alone are one file on some systems
    text = str(config.input)  # type: ignore[attr-defined]
    written = {(out / name).resolve() for name in (*earlier, TABLE)}
    for source in find_sources([text], suffixes_of(AUTO), keep_bad=True):
        if not source.archive and Path(source.name).resolve() in written:
            continue
        if PurePosixPath(source.member).name == _SPLITS and not source.named:
            continue
        own = source.suffix
        suffix = config.suffix_of(own, _WRITABLE)
        inner = PurePosixPath(source.member.replace("\\", "/"))
        folders = [part for part in inner.parts[:-1] if part not in ("..", ".", "/")]
        if source.archive and Path(source.archive) != Path(text):
            folders = [Path(source.archive).name.removesuffix(archive_suffix(source.archive) or ""), *folders]
        folder = out.joinpath(*(FileNames().of(part) for part in folders))
        plain = names.setdefault(str(folder), FileNames())
        # The last name is for files of one name from different folders of a pattern.
        for name in (inner.stem, inner.stem + own.replace(".", "_"), source.name):
            output = folder / f"{plain.of(name)}{suffix}"
            files = config.outputs_of(output)
            wanted = {folded(str(file)) for file in files}
            if taken.isdisjoint(wanted):
                break
        else:
            raise UsageError(f"Two files would be written as {output}.", "Give them one by one.")
        taken |= wanted
        yield FileRun(source, output, files)


def _digest_of(config: ManyFilesConfig) -> str:
    """Of the settings that the results depend on."""
    settings = config.model_dump(mode="json", exclude={"input", "output"})
    return hashlib.sha256(json.dumps([type(config).__module__, settings], sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class _Earlier:
    """The last run into the folder.

    outputs: names of the files that it planned. same: whether it had the same settings. done: if so, its outcomes by
        input.
    """

    outputs: frozenset[str] = frozenset()
    same: bool = False
    done: Mapping[str, dict[str, Any]] = field(default_factory=dict)


def _earlier(out: Path, digest: str) -> _Earlier:
    try:
        lines = (out / JOURNAL).read_text(encoding="utf-8").splitlines()
        head = json.loads(lines[0])
        outputs, same = frozenset(map(str, head["outputs"])), head["settings"] == digest
    except (OSError, ValueError, IndexError, KeyError, TypeError):
        return _Earlier()
    rows = filter(None, map(_row_of_line, lines[1:]))
    return _Earlier(outputs, same, {row["input"]: row for row in rows} if same else {})


def _row_of_line(line: str) -> dict[str, Any] | None:
    """An outcome; None for a line that a kill cut off."""
    try:
        row = json.loads(line)
    except ValueError:
        return None
    return row if isinstance(row, dict) and set(COLUMNS) <= set(row) else None


def _still_there(done: Mapping[str, dict[str, Any]], each: FileRun, out: Path) -> dict[str, Any] | None:
    """The earlier outcome of a file, if its input is unchanged and its output exists."""
    row = done.get(each.source.name)
    if row is None or row.get("status") != WRITTEN or not all(file.is_file() for file in each.files):
        return None
    try:
        same = row["sha256"] == hashlib.sha256(each.source.read()).hexdigest()
    except PumpsError:
        return None
    return row if same and row["output"] == str(each.output.relative_to(out)) else None


def _outcomes(config: Any, run: Run, to_do: list[FileRun], out: Path) -> Iterator[dict[str, Any]]:
    """The outcome of each file as it is done. If a process of this machine dies, all files that are left are run one
    after another, each in a new process."""
    if config.cluster is not None and to_do:
        with cluster_pool(config.cluster) as pool:
            yield from _as_done(pool, config, run, to_do, out)
        return
    count = min(config.jobs or cores(), len(to_do))
    if count <= 1:
        for each in to_do:
            yield run_one(run, config, each, out)
        return
    left = {each.source.name: each for each in to_do}
    with process_pool(count) as pool:
        for row in _as_done(pool, config, run, to_do, out):
            if row["status"] == DIED:
                break
            del left[row["input"]]
            yield row
    for each in left.values():
        with process_pool(1) as pool:
            yield from _as_done(pool, config, run, [each], out)


def _as_done(pool: Executor, config: Any, run: Run, to_do: list[FileRun], out: Path) -> Iterator[dict[str, Any]]:
    """The outcome of each file as a pool is done with it; DIED for one that its process died of."""
    waiting = {pool.submit(run_one, run, config, each, out): each for each in to_do}
    for future in as_completed(waiting):
        row = result_or_death(future)
        yield _dead(waiting[future], out) if isinstance(row, TaskDied) else row


def run_one(run: Run, config: Any, each: FileRun, out: Path) -> dict[str, Any]:
    """The outcome of one file as a row; whatever fails is a row too."""
    started = time.perf_counter()
    try:
        sha256 = hashlib.sha256(each.source.read()).hexdigest()
        each.output.parent.mkdir(parents=True, exist_ok=True)
        single = config.model_copy(
            update={"input": type(config.input)(each.source.name), "output": each.output, "overwrite": True}
        )
        figures, named = run(single).figures, ("frames", *config.table_columns)
        row = _row(each, out, WRITTEN, **{name: _cell(figures.get(name, "")) for name in named}, sha256=sha256)
    except PumpsError as error:
        row = _row(each, out, FAILED, reason=" ".join(f"{error.message} {error.hint or ''}".split()))
    except Exception as error:  # a fault of one file must not cost all others
        row = _row(each, out, FAILED, reason=" ".join(f"{type(error).__name__}: {error}".split())[:300])
    return {**row, "seconds": round(time.perf_counter() - started, 3)}


def _dead(each: FileRun, out: Path) -> dict[str, Any]:
    return _row(each, out, DIED, reason="Its process was ended, perhaps for want of memory.")


def _row(each: FileRun, out: Path, status: str, **more: Any) -> dict[str, Any]:
    output = str(each.output.relative_to(out)) if status == WRITTEN else ""
    blank = dict.fromkeys(COLUMNS, "")
    return {**blank, "input": each.source.name, "output": output, "status": status, **more}


def _journal_head(digest: str, runs: list[FileRun], out: Path) -> bytes:
    return _line(
        {"settings": digest, "outputs": [str(file.relative_to(out)) for each in runs for file in each.files]}
    )


def _line(row: dict[str, Any]) -> bytes:
    return json.dumps(row).encode() + b"\n"


def _cell(figure: Any) -> Any:
    """A figure of a report in one cell; sentences and names one after another."""
    return " ".join(map(str, figure)) if isinstance(figure, (list, tuple)) else figure


def _table(rows: list[dict[str, Any]], columns: tuple[str, ...]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: text_cell(str(value)) for name, value in row.items()} for row in rows)
    return text.getvalue().encode()


def _report(out: Path, rows: list[dict[str, Any]], kept: int, seconds: float) -> StageReport:
    failed = [row for row in rows if row["status"] != WRITTEN]
    if len(failed) == len(rows):
        raise InputError(f"None of {counted(len(rows), 'file')} could be used; the first: {failed[0]['reason']}")
    made = len(rows) - len(failed) - kept
    # Most reasons begin with the file's name.
    shown = failed[:_SHOWN]
    lines = [
        row["reason"] if row["reason"].startswith(row["input"]) else f"{row['input']}: {row['reason']}"
        for row in shown
    ]
    if len(failed) > _SHOWN:
        lines.append(f"and {len(failed) - _SHOWN} more that failed, all of them in {out / TABLE}")
    rate = f", {60 * made / seconds:.0f} a minute" if made else ""
    already = f"; {kept} were there from an earlier run" if kept else ""
    lines.append(
        f"Wrote {made} of {counted(len(rows), 'file')} into {out} in {seconds:.1f} s{rate}{already}; "
        f"{len(failed)} failed."
    )
    figures = {
        "files": len(rows), "written": made, "kept": kept, "failed": len(failed), "seconds": seconds,
        "table": str(out / TABLE),
    }  # fmt: skip
    return StageReport(output=out, lines=lines, figures=figures)
