"""`pumps refine` mends the flawed frames of a motion of a known action, or of all motions of an artefact."""

from __future__ import annotations

import time

from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import names_artefact
from data_schemas.notes import sentences_of
from stages.refine.artefact import run_artefact
from stages.refine.config import Config
from stages.refine.page import page_of
from stages.refine.table import csv_of
from stages.shared.contract import StageReport
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.skeleton_map import choose_map, read_skeleton_map
from stages.shared.formats.sources import source_named
from stages.shared.formats.writers import SUFFIXES, bytes_of_motion, written_format
from stages.shared.inference.refined_motion import refined_motion
from stages.shared.inference.refining import load_concepts
from stages.shared.outputs import check_artefact, check_file, write_output
from stages.shared.progress import SILENT, Progress

_SHOWN = 12  # anchors in the lines


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Refine a motion, or the motions of an artefact.

    Raises: UsageError for an action that was not learned; InputError for a bad file, another rig than the weights',
        or a clip that is too short.
    """
    started = time.perf_counter()
    of_artefact = names_artefact(config.input)
    if of_artefact:
        check_artefact(config, "motion")
    else:
        check_file(config, SUFFIXES.values())
    if config.table is not None:
        check_file(config, (".csv",), "table")
    if config.page is not None:
        check_file(config, (".html",), "page")
    model = load_concepts(config.weights, config.device)
    if config.action is not None:
        model.action(config.action)
    if of_artefact:
        for option in ("fps_override", "skeleton_map"):
            if getattr(config, option) is not None:
                flag = option.replace("_", "-")
                raise UsageError(f"--{flag} is for files, and the input is an artefact.", "Give it to pumps ingest.")
        return run_artefact(config, model, progress)
    if config.action is None:
        raise UsageError("A file does not say its action.", f"Give --action, one of {', '.join(model.actions)}.")
    progress.start("refining", 3)
    recording = _recording(config)
    progress.advance(note="read")
    found = refined_motion(
        model, recording.skeleton, recording.motion, config.action, config.only, config.seed, str(config.input)
    )
    progress.advance(note="refined")
    form = written_format(config.output)
    data, losses = bytes_of_motion(form, recording.skeleton, found.motion, config.output.stem)
    write_output(config.output, data)
    rows = found.anchors(model.fps)
    if config.table is not None:
        write_output(config.table, csv_of(rows))
    if config.page is not None:
        write_output(config.page, page_of([(config.input.name, config.action, found)], config, model.fps))
    progress.advance(note="written")
    notes = [*sentences_of(recording.notes), *losses]
    flawed = int(found.found.flawed.sum())
    lines = [
        *[f"Note: {note}" for note in notes],
        f"{flawed} of {len(rows)} anchors were judged flawed; joints moved by {found.moved_mm:.1f} mm (mean), in "
        f"{time.perf_counter() - started:.2f} s.",
        *[
            f"Anchor at frame {row['frame']} ({row['seconds']:.2f} s): score {row['score']:.1f}, moved by "
            f"{row['moved_mm']:.0f} mm."
            for row in rows if row["flawed"]
        ][:_SHOWN],
    ]  # fmt: skip
    return StageReport(
        output=config.output,
        lines=lines,
        figures={"anchors": rows, "flawed": flawed, "moved_mm": found.moved_mm, "notes": notes},
    )


def _recording(config: Config) -> Recording:
    source = source_named(str(config.input))
    maps = (read_skeleton_map(config.skeleton_map),) if config.skeleton_map else ()
    found = list(recordings_in(source, Asked(fps_override=config.fps_override, skeleton_maps=maps)))
    if len(found) != 1:
        raise InputError(
            f"{source.name} holds {len(found)} clips, and one is refined at a time.",
            "Export the clip first: pumps export FILE --clip NAME -o clip.bvh.",
        )
    choose_map(maps, found[0].skeleton.names, must_fit=bool(maps))
    return found[0]
