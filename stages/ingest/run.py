"""`pumps ingest`: recordings of any humanoids into one `motion` artefact."""

from __future__ import annotations

import glob
import re
from collections import Counter
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.motion import ClipRow, MotionWriter
from stages.config import StageReport
from stages.formats.sources import Source, find_sources
from stages.ingest.config import Config
from stages.ingest.licences import licence_of
from stages.ingest.reading import Job, Outcome, read_all
from stages.ingest.splits import SPLITS_NAME, Assigned, assign_splits
from stages.progress import SILENT, Progress

_LINES_SHOWN = 40


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Read every recording of `config.sources` and write the artefact `config.output`.

    A bad file is reported and skipped, unless `config.strict`.
    Raises: UsageError for options that cannot be; InputError where nothing could be kept, or for the first bad file
        if strict.
    """
    sources = find_sources(config.sources)
    overrides = _parse_overrides(config.fps_override)
    trim_first = _parse_trim(config.trim_first)
    assigned = assign_splits(sources, config.splits)
    notes = assigned.notes
    jobs = [Job(source, _override_of(source, overrides), trim_first, config.rest_frame) for source in sources]
    outcomes: list[tuple[str, str, str, str]] = []  # source, status, clip, notes
    clips = _ClipNames()
    rows: list[ClipRow] = []
    progress.start("Reading recordings", total=sum(source.size for source in sources) / 1e6)
    with (
        write_artefact(config.output, "motion", stage="ingest", config=config, inputs=_inputs(config)) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for job, outcome in zip(jobs, read_all(jobs, config.workers), strict=True):
            progress.advance(outcome.source.size / 1e6, PurePosixPath(outcome.source.member).name)
            clip = ""
            if outcome.motion is None:
                if config.strict:
                    raise InputError(outcome.notes[0], outcome.hint)
            else:
                clip = clips.name(outcome.source)
                rows.append(_store(writer, outcome, job, clip, assigned, config.licence))
            outcomes.append((outcome.source.name, outcome.status, clip, " ".join(outcome.notes)))
        if not rows:
            first = outcomes[0][3]
            raise InputError(f"None of the {len(outcomes)} recordings could be used. The first: {first}")
        draft.licences |= {row.licence for row in rows}
        draft.summary |= _summary(outcomes, rows, notes)
    return _report(config, outcomes, rows, notes)


def _store(
    writer: MotionWriter,
    outcome: Outcome,
    job: Job,
    clip: str,
    assigned: Assigned,
    licence: str | None,
) -> ClipRow:
    assert outcome.motion is not None and outcome.skeleton is not None
    motion = outcome.motion
    data_set = outcome.source.data_set
    row = ClipRow(
        clip=clip,
        source=outcome.source.name,
        sha256=outcome.sha256,
        skeleton=writer.add_skeleton(outcome.skeleton),
        frames=motion.frames,
        fps=motion.fps,
        seconds=motion.frames / motion.fps,
        split=assigned.splits[outcome.source.name],
        licence=licence_of(data_set, licence or assigned.licences.get(data_set)),
        flags=_flags(outcome, job),
    )
    writer.add_clip(row, motion)
    return row


def _flags(outcome: Outcome, job: Job) -> str:
    words = []
    if job.fps_override is not None:
        words.append("fps-override")
    if any(note.startswith("Dropped the first") for note in outcome.notes):
        words.append("trimmed")
    if any(note.startswith("Frames says") for note in outcome.notes):
        words.append("frames-line-off")
    return " ".join(words)


class _ClipNames:
    """Names for clips from their archive and member: safe to be a path's part, and unique."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def name(self, source: Source) -> str:
        stem = PurePosixPath(source.member.replace("\\", "/")).with_suffix("").as_posix()
        data_set = source.data_set[:-4] if source.data_set.lower().endswith(".zip") else source.data_set
        path = stem if stem.split("/")[0] == data_set else f"{data_set}/{stem}"
        base = re.sub(r"[^A-Za-z0-9_.-]+", "_", path.replace("/", ".")).strip("._") or "clip"
        name, copy = base[:200], 1
        while name.lower() in self._taken:
            copy += 1
            name = f"{base[:190]}-{copy}"
        self._taken.add(name.lower())
        return name


def _parse_overrides(texts: Sequence[str]) -> list[tuple[str, float]]:
    overrides = []
    for text in texts:
        pattern, _, rate = text.rpartition("=")
        try:
            fps = float(rate)
        except ValueError:
            fps = 0.0
        if not pattern or not 0 < fps <= 10_000:
            raise UsageError(f"--fps-override '{text}' is no PATTERN=RATE.", "For example '*salsa*=60'.")
        overrides.append((pattern, fps))
    return overrides


def _override_of(source: Source, overrides: Sequence[tuple[str, float]]) -> float | None:
    for pattern, fps in overrides:
        if fnmatch(source.name, pattern) or fnmatch(source.member, pattern):
            return fps
    return None


def _parse_trim(text: str) -> str:
    if text == "auto" or re.fullmatch(r"\d{1,6}", text):
        return text
    raise UsageError(f"--trim-first is '{text}' and must be a number of frames or auto.")


def _inputs(config: Config) -> list[Path]:
    """Files and folders on the disk that the sources stand for, and the splits."""
    paths: list[Path] = []
    for text in config.sources:
        path = Path(text)
        if path.exists():
            paths.append(path)
        elif glob.has_magic(text):
            paths += [Path(match) for match in sorted(glob.glob(text, recursive=True)) if Path(match).is_file()]
        elif "!" in text:
            paths.append(Path(text.split("!", 1)[0]))
    if config.splits:
        paths.append(config.splits)
    else:
        beside = {path.parent / SPLITS_NAME for path in paths if path.is_file()}
        paths += sorted(path for path in beside if path.is_file())
    return list(dict.fromkeys(paths))


def _summary(outcomes: Sequence[tuple[str, str, str, str]], rows: Sequence[ClipRow], notes: Sequence[str]) -> dict:
    return {
        "files": dict(Counter(status for _, status, _, _ in outcomes)),
        "clips": len(rows),
        "frames": sum(row.frames for row in rows),
        "seconds": round(sum(row.seconds for row in rows), 3),
        "splits": dict(Counter(row.split for row in rows)),
        "skeletons": dict(Counter(row.skeleton for row in rows)),
        "notes": list(notes),
        "outcomes": [
            {"source": source, "outcome": status, "clip": clip, "reason": reason}
            for source, status, clip, reason in outcomes
        ],
    }


def _report(
    config: Config, outcomes: Sequence[tuple[str, str, str, str]], rows: Sequence[ClipRow], notes: Sequence[str]
) -> StageReport:
    counts = Counter(status for _, status, _, _ in outcomes)
    skeletons = Counter(row.skeleton for row in rows)
    splits = Counter(row.split for row in rows)
    minutes = sum(row.seconds for row in rows) / 60
    lines = [
        f"{len(rows)} clips, {sum(row.frames for row in rows)} frames, {minutes:.1f} minutes"
        f" on {len(skeletons)} skeleton{'s' if len(skeletons) > 1 else ''}"
        f" ({', '.join(f'{splits[name]} {name}' for name in ('train', 'val', 'test'))}).",
        f"Files: {counts['kept']} kept as they are, {counts['repaired']} repaired, {counts['skipped']} skipped.",
        *notes,
    ]
    odd = [outcome for outcome in outcomes if outcome[1] != "kept"]
    odd.sort(key=lambda outcome: outcome[1] != "skipped")
    lines += [f"{status}: {source}: {reason}" for source, status, _, reason in odd[:_LINES_SHOWN]]
    if len(odd) > _LINES_SHOWN:
        lines.append(f"... and {len(odd) - _LINES_SHOWN} more; the manifest's summary lists what was done with each.")
    if any(row.licence == "unknown" for row in rows):
        lines.append("The licence of some recordings is unknown; say it with --licence.")
    figures = {"clips": len(rows), "files": dict(counts), "splits": dict(splits), "skeletons": len(skeletons)}
    return StageReport(output=config.output, lines=lines, figures=figures)
