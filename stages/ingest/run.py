"""`pumps ingest`: recordings of any humanoids into one `motion` artefact."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import PurePosixPath

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.motion import ClipRow, MotionWriter
from data_schemas.notes import Flag, flags_text, sentences_of
from data_schemas.source_table import SOURCES_NAME, SourceRow, write_sources
from stages.ingest.config import Config
from stages.ingest.doubts import doubts_of
from stages.ingest.inputs import digests_of_read, given_files
from stages.ingest.licences import licence_of
from stages.shared.contract import StageReport
from stages.shared.formats.clip_names import ClipNames
from stages.shared.formats.known_facts import asked_of, known_rate, rate_notes
from stages.shared.formats.readers import suffixes_of
from stages.shared.formats.reading import Job, Outcome, read_all
from stages.shared.formats.recording import Asked
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.skeleton_map import read_skeleton_maps, unused_maps
from stages.shared.formats.sources import Source, find_sources
from stages.shared.formats.splits import Assigned, assign_splits
from stages.shared.formats.usual_units import usual_units, with_units
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress

_LINES_SHOWN = 40


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Read every recording of `config.sources` and write the artefact `config.output`.

    A bad file is reported and skipped, unless `config.strict`; `sources.parquet` records the outcome of each file.
    Raises: UsageError for invalid options; InputError if nothing could be kept, or for the first bad file if strict.
    """
    check_artefact(config, "motion")
    overrides = _parse_overrides(config.fps_override)
    asked = _asked(config)
    sources = find_sources(config.sources, suffixes_of(config.format), keep_bad=not config.strict)
    assigned = assign_splits(sources, config.splits)
    sources = [source for source in sources if source.name in assigned.splits]
    if not sources:
        raise InputError(f"{config.splits} names none of the recordings.", "Check --splits.")
    rates = {source.name: _override_of(source, overrides) for source in sources}
    known = {source.name: known_rate(source) for source in sources if rates[source.name] is None}
    jobs = [
        Job(source, config.format, asked_of(source, asked, rates[source.name] or known.get(source.name)))
        for source in sources
    ]
    units = usual_units(jobs, config.workers, config.cluster)
    # Splits and units are found for all sources, so that they are the same in every part.
    jobs = [with_units(job, units) for job in config.share_of(jobs)]
    sources = [job.source for job in jobs]
    if not sources:
        raise UsageError(f"--shard {config.shard} has no recording: there are fewer recordings than shards.")
    clips = ClipNames()
    rows: list[ClipRow] = []
    table: list[SourceRow] = []
    rigs: set[tuple[str, ...]] = set()
    progress.start("Reading recordings", total=sum(source.size for source in sources) / 1e6)
    with (
        write_artefact(config.output, "motion", stage="ingest", config=config, inputs=given_files(config)) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for job, outcome in zip(jobs, read_all(jobs, config.workers, config.cluster), strict=True):
            progress.advance(outcome.source.size / 1e6, PurePosixPath(outcome.source.member).name)
            if outcome.status == "skipped" and config.strict:
                raise InputError(outcome.reason, outcome.hint)
            made = _store(writer, outcome, job, clips, assigned, config.licence)
            rows += made
            table.append(_source_row(outcome, job, made))
            rigs |= {recording.skeleton.names for recording in outcome.recordings}
        if not rows:
            bad = next((row.reason for row in table if row.outcome == "skipped"), table[0].reason)
            raise InputError(f"None of the {len(table)} recordings could be used. The first: {bad}")
        write_sources(draft.folder, table)
        draft.sources += digests_of_read(config, ((row.source, row.sha256) for row in table))
        draft.licences |= {row.licence for row in rows}
        notes = [*assigned.notes, *rate_notes(sources, known), *unused_maps(asked.skeleton_maps, rigs)]
        draft.summary |= _summary(table, rows, notes)
    return _report(config, table, rows, notes)


def _asked(config: Config) -> Asked:
    """The settings for all sources."""
    rig, rig_name = rig_named(config.skeleton) if config.skeleton is not None else (b"", "")
    if config.body_models is not None and not config.body_models.is_dir():
        raise UsageError(
            f"--body-models {config.body_models} is not a folder.", "It must hold smplh/male/model.npz and so on."
        )
    return Asked(
        None, config.rest_frame, _parse_trim(config.trim_first), rig, rig_name, config.body_models,
        read_skeleton_maps(config.skeleton_map), config.up_axis,
    )  # fmt: skip


def _store(
    writer: MotionWriter,
    outcome: Outcome,
    job: Job,
    clips: ClipNames,
    assigned: Assigned,
    licence: str | None,
) -> list[ClipRow]:
    """Write the clips of one source and return their rows."""
    data_set = outcome.source.data_set
    rows = []
    for recording, quality in zip(outcome.recordings, outcome.qualities, strict=True):
        motion = recording.motion
        row = ClipRow(
            clip=clips.name(outcome.source, recording.part),
            source=outcome.source.name,
            sha256=outcome.sha256,
            skeleton=writer.add_skeleton(recording.skeleton),
            frames=motion.frames,
            fps=motion.fps,
            seconds=motion.frames / motion.fps,
            split=assigned.splits[outcome.source.name],
            licence=licence_of(data_set, licence or assigned.licences.get(data_set)),
            flags=flags_text([*_given(job), *(each.flag for each in recording.notes)]),
            quality=quality,
        )
        writer.add_clip(row, motion)
        rows.append(row)
    return rows


def _source_row(outcome: Outcome, job: Job, made: Sequence[ClipRow]) -> SourceRow:
    return SourceRow(
        source=outcome.source.name,
        format=outcome.format,
        outcome=outcome.status,
        reason=outcome.reason or " ".join(sentences_of(outcome.notes)),
        remarks=" ".join(sentences_of(outcome.remarks)),
        flags=flags_text([*_given(job), *(each.flag for each in (*outcome.notes, *outcome.remarks))] if made else []),
        clips=len(made),
        frames=sum(row.frames for row in made),
        bytes=outcome.source.size,
        sha256=outcome.sha256,
    )


def _given(job: Job) -> list[Flag]:
    """The codes of what the user said of a recording."""
    return [Flag.FPS_OVERRIDE] if job.asked.fps_override is not None else []


def _parse_overrides(texts: Sequence[str]) -> list[tuple[str, float]]:
    overrides = []
    for text in texts:
        pattern, _, rate = text.rpartition("=")
        try:
            fps = float(rate)
        except ValueError:
            fps = 0.0
        if not pattern or not 0 < fps <= 10_000:
            raise UsageError(f"--fps-override '{text}' is not PATTERN=RATE.", "For example '*salsa*=60'.")
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
    raise UsageError(f"--trim-first is '{text}', but must be a number of frames or auto.")


def _summary(table: Sequence[SourceRow], rows: Sequence[ClipRow], notes: Sequence[str]) -> dict:
    return {
        "files": dict(Counter(row.outcome for row in table)),
        "formats": dict(Counter(row.format for row in table if row.clips)),
        "clips": len(rows),
        "frames": sum(row.frames for row in rows),
        "seconds": round(sum(row.seconds for row in rows), 3),
        "splits": dict(Counter(row.split for row in rows)),
        "skeletons": dict(Counter(row.skeleton for row in rows)),
        "notes": list(notes),
    }


def _report(config: Config, table: Sequence[SourceRow], rows: Sequence[ClipRow], notes: Sequence[str]) -> StageReport:
    counts = Counter(row.outcome for row in table)
    skeletons = Counter(row.skeleton for row in rows)
    splits = Counter(row.split for row in rows)
    minutes = sum(row.seconds for row in rows) / 60
    ignored = f", {counts['ignored']} ignored (not recordings)" if counts["ignored"] else ""
    lines = [
        f"{len(rows)} clips, {sum(row.frames for row in rows)} frames, {minutes:.1f} minutes"
        f" on {len(skeletons)} skeleton{'s' if len(skeletons) > 1 else ''}"
        f" ({', '.join(f'{splits[name]} {name}' for name in ('train', 'val', 'test'))}).",
        f"Files: {counts['kept']} kept as they are, {counts['repaired']} repaired, {counts['skipped']} skipped"
        f"{ignored}.",
        *notes,
    ]
    for remark, count in Counter(row.remarks for row in table if row.remarks and row.clips).most_common(3):
        lines.append(f"{count} file{'s' if count > 1 else ''}: {remark}")
    lines += doubts_of(rows)
    odd = [row for row in table if row.outcome in ("skipped", "repaired")]
    odd.sort(key=lambda row: row.outcome != "skipped")
    lines += [f"{row.outcome}: {row.source}: {row.reason}" for row in odd[:_LINES_SHOWN]]
    if len(odd) > _LINES_SHOWN:
        lines.append(f"... and {len(odd) - _LINES_SHOWN} more; the artefact's {SOURCES_NAME} lists every file.")
    if any(row.licence == "unknown" for row in rows):
        lines.append("The licence of some recordings is unknown; state it with --licence.")
    figures = {"clips": len(rows), "files": dict(counts), "splits": dict(splits), "skeletons": len(skeletons)}
    return StageReport(output=config.output, lines=lines, figures=figures)
