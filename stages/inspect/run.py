"""`pumps inspect`: describe a motion file and how pumps interprets it."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial

from data_schemas.errors import InputError, PumpsError
from stages.inspect.config import Config
from stages.inspect.described import Described, describe_bare_bvh, describe_recording
from stages.shared.contract import StageReport
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.readers import AUTO, Format, read_recordings, recognise, suffixes_of
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.skeleton_map import choose_map, read_skeleton_map, text_of_anatomy
from stages.shared.formats.sources import Source, find_sources, source_named
from stages.shared.many_files.file_runs import names_many, run_over_files
from stages.shared.outputs import check_file, write_output
from stages.shared.pools import TaskDied, cluster_pool, process_pool, results_in_order
from stages.shared.progress import SILENT, Progress
from stages.shared.threads import cores

_WORTH_PROCESSES = 16  # fewer files are read sooner than processes start


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Describe one file in full, or every file of an archive, folder or pattern: in one line each, or in a file each.

    Raises: InputError if there is nothing to read, the file is not a recording, or a skeleton map does not match;
        UsageError for an output that may not be written.
    """
    if config.output is not None:
        return run_over_files(config, _written, progress) if names_many(config.input) else _written(config)
    sources = find_sources([config.input], suffixes_of(AUTO))
    asked = _asked(config)
    if len(sources) == 1:
        found = _read(sources[0], asked)
        return _map_of(found) if config.map else _in_full(found)
    if config.map:
        raise InputError(
            f"{config.input} holds {len(sources)} files, but a map is for one rig.",
            "Name one of them, or a folder for a map of each with --output.",
        )
    return _listed(sources, asked, config, progress)


def _written(config: Config) -> StageReport:
    """The description of one file, which is written too."""
    assert config.output is not None
    check_file(config)
    found = _read(source_named(config.input), _asked(config))
    report = _map_of(found) if config.map else _in_full(found)
    text = report.figures["map"] if config.map else json.dumps(report.figures, indent=1) + "\n"
    write_output(config.output, text.encode())
    clips = report.figures.get("clips", [])
    if clips:  # the table's row is of the whole file, and not of its first clip
        problems = list(dict.fromkeys(problem for clip in clips for problem in clip["problems"]))
        report.figures |= {"frames": sum(clip["frames"] for clip in clips), "problems": problems}
    return report.model_copy(update={"output": config.output})


def _asked(config: Config) -> Asked:
    maps = (read_skeleton_map(config.skeleton_map),) if config.skeleton_map else ()
    rig, rig_name = rig_named(config.skeleton) if config.skeleton else (b"", "")
    return Asked(
        fps_override=config.fps_override, rest_frame=config.rest_frame, trim_first="auto",
        rig=rig, rig_name=rig_name, body_models=config.body_models, skeleton_maps=maps,
        up_axis=config.up_axis,
    )  # fmt: skip


@dataclass(frozen=True)
class _Found:
    """The content of one file. fault: why its joints are not a humanoid's; then `recordings` is empty."""

    source: Source
    chosen: Format
    recordings: list[Recording]
    bvh: BvhFile | None
    fault: str = ""
    mapped: bool = False
    rate_given: bool = False


def _read(source: Source, asked: Asked) -> _Found:
    data = source.read()
    chosen = recognise(data, source.name)
    if chosen is None:
        raise InputError(
            f"{source.name} is not a recording in a format that pumps reads.", "docs/formats.md lists the formats."
        )
    bvh = read_bvh(data, source.name) if chosen.name == "bvh" else None
    if bvh is not None and asked.skeleton_maps:
        choose_map(asked.skeleton_maps, [joint.name for joint in bvh.joints], must_fit=True)
    try:
        recordings = read_recordings(data, source, chosen, asked)
    except InputError as error:
        if bvh is None or asked.skeleton_maps:
            raise
        return _Found(source, chosen, [], bvh, error.message)
    for recording in recordings:
        choose_map(asked.skeleton_maps, recording.skeleton.names, must_fit=bool(asked.skeleton_maps))
    return _Found(
        source, chosen, recordings, bvh, mapped=bool(asked.skeleton_maps), rate_given=asked.fps_override is not None
    )


def _described(found: _Found) -> list[Described]:
    if found.bvh is not None and not found.recordings:
        return [describe_bare_bvh(found.bvh, found.fault)]
    return [
        describe_recording(recording, found.bvh, mapped=found.mapped, rate_given=found.rate_given)
        for recording in found.recordings
    ]


def _in_full(found: _Found) -> StageReport:
    report = StageReport(lines=[found.source.name])
    described = _described(found)
    for each in described:
        start = len(report.lines)
        report.lines += each.lines
        report.tints |= {start + line: tint for line, tint in each.tints.items()}
    figures = {"file": found.source.name, "format": found.chosen.name, **described[0].figures}
    if len(described) > 1:
        figures["clips"] = [each.figures for each in described]
    report.figures.update(figures)
    return report


def _map_of(found: _Found) -> StageReport:
    if not found.recordings:
        raise InputError(found.fault, "Write a map by hand: docs/formats.md shows one.")
    described = describe_recording(found.recordings[0], found.bvh, mapped=found.mapped)
    skeleton = found.recordings[0].skeleton
    assert described.anatomy is not None
    text = text_of_anatomy(described.anatomy, skeleton.names, skeleton.parents, found.source.name)
    return StageReport(lines=text.rstrip("\n").split("\n"), figures={"map": text})


def _listed(sources: list[Source], asked: Asked, config: Config, progress: Progress) -> StageReport:
    report = StageReport()
    problems = 0
    progress.start("Inspecting", total=len(sources))
    count = config.jobs or (cores() if len(sources) >= _WORTH_PROCESSES else 1)
    here = nullcontext() if count == 1 else process_pool(min(count, len(sources)))
    with cluster_pool(config.cluster) if config.cluster is not None else here as pool:
        for source, line in zip(sources, results_in_order(pool, partial(_in_one_line, asked), sources), strict=True):
            if isinstance(line, TaskDied):
                raise PumpsError(
                    f"A process was ended about {source.member}, perhaps for want of memory.",
                    "Give --output, with which the other files are described all the same.",
                )
            described, found = line
            problems += bool(found)
            if found:
                report.tints[len(report.lines)] = "problem"
            report.lines.append(f"{source.member}: {described}" + (f"; {' '.join(found)}" if found else ""))
            progress.advance(1, source.member)
    report.lines.append(f"{len(sources)} files, {problems} of them with problems or notes.")
    report.figures.update({"files": len(sources), "with_problems": problems})
    return report


def _in_one_line(asked: Asked, source: Source) -> tuple[str, list[str]]:
    """The size of a file's clips, and its problems, a sentence each."""
    try:
        figures = [each.figures for each in _described(_read(source, asked))]
    except InputError as error:
        return "unreadable", [error.message]
    found = [problem for each in figures for problem in each["problems"]]
    clips = (f"{each['frames']} frames at {each['fps']:g} fps" for each in figures[:3])
    return f"{figures[0]['joints']} joints, " + " and ".join(clips), found
