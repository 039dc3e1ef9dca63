"""`pumps infill`: a file of rows and its keyframes in, the same file with the frames between filled out."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from data_schemas.errors import UsageError
from data_schemas.skeleton import Skeleton
from stages.infill.config import Config
from stages.infill.constrained import (
    check_constraints,
    constrained_motion,
    constraints_of_config,
    motion_of_keys,
    request_in_parts,
)
from stages.infill.fillers import Filler, filler_of
from stages.infill.request import Request, request_of
from stages.infill.row_files import RowFile, row_file
from stages.infill.samples import with_samples
from stages.infill.summary import (
    fallbacks_of,
    line_of_skate,
    lines_of_fallbacks,
    lines_of_jumps,
    lines_of_pins,
    warnings_of,
)
from stages.shared.contract import StageReport
from stages.shared.formats.skeleton_map import read_skeleton_map
from stages.shared.formats.sources import source_named
from stages.shared.formats.writers import SUFFIXES, bytes_of_motion, written_format
from stages.shared.inference.constraints.asked import Constraints
from stages.shared.inference.filled import Filled
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.gap_speed import sentences_of_speed
from stages.shared.many_files.file_runs import over_files
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.tables import counted
from stages.shared.weights.licence_names import licence_names


class Region(NamedTuple):
    """The stretch of the output that is filled: from frame `first`, with the keys that matter to it."""

    first: int
    frames: int
    keys: np.ndarray  # frames of the output
    of_all: np.ndarray  # which of the request's keys these are


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Fill a BVH or a robot's joint angles. Rows that are neither keys nor outside of them are not read.

    Raises: UsageError for options that contradict each other; InputError for a file, frames or weights that are bad.
    """
    started = time.perf_counter()
    outputs = config.outputs_of(config.output)
    for output in outputs:
        check_file(config.model_copy(update={"output": output}), SUFFIXES.values())
    file = row_file(source_named(str(config.input)), config)
    progress.start("filling", 3)
    filler = filler_of(config)
    progress.advance(note="weights")
    made = fill_files(file, config, filler)
    progress.advance(note="filled")
    converted = [_in_format_of(output, file, each) for output, each in zip(outputs, made, strict=True)]
    for output, (data, _) in zip(outputs, converted, strict=True):
        write_output(output, data)
    progress.advance(note="written")
    report = _report(config, made[0], filler, converted[0][1], time.perf_counter() - started)
    if len(made) == 1:
        return report
    missing = made[0].request.missing - made[0].region.first
    return with_samples(report, outputs, made[0].skeleton, [each.filled for each in made], missing)


@dataclass(frozen=True)
class FilledFile:
    """A filled file.

    data:   its bytes; keys and what lies outside of them stand in it as they stood in the input.
    filled: what was filled, from frame `region.first` on. notes: on the input, one sentence each.
    """

    data: bytes
    request: Request
    region: Region
    skeleton: Skeleton
    filled: Filled
    notes: tuple[str, ...]


def fill_files(file: RowFile, config: Config, filler: Filler, also: Constraints | None = None) -> list[FilledFile]:
    """Fill a file of rows between its keys, `config.samples` times. Rows between keys are not read.

    Args:
        config: which frames are keys, and how to fill; its input, output and weights are not looked at.
        filler: what fills (`filler_of`).
        also: constraints beside those of the config.

    Returns: the usual fill first, then others (`Filler.fills`).
    Raises: UsageError for options that contradict each other; InputError for bad rows or frames, and for weights that
        do not hold how motions vary.
    """
    if config.fps_override is not None and not 0 < config.fps_override < 1e6:
        raise UsageError(f"--fps-override {config.fps_override} is not a frame rate.", "Give frames a second.")
    asked, asked_notes = constraints_of_config(config)
    if also is not None:
        asked = asked.joined(also)
    check_constraints(asked, file.suffix)
    config = config.model_copy(update={"keyframes": asked.keyframes})
    maps = (read_skeleton_map(config.skeleton_map),) if config.skeleton_map else ()
    parts = None
    if asked.by_part:
        request, parts = request_in_parts(config, asked, file, maps)
        skeleton, motion, notes = file.part_motion(parts, maps)
    else:
        request = request_of(config, file.frames, file.fps)
        skeleton, motion, notes = file.key_motion(request.key_rows, maps)
    region = _region_of(request, filler.window, motion.fps)
    if asked.any:
        whole, fixed, constraint_notes = constrained_motion(skeleton, motion, request, parts, asked)
        rows = slice(region.first, region.first + region.frames)
        given, fixed = whole.at(rows), fixed.rows(rows)
        notes = [*notes, *constraint_notes]
    else:
        given, fixed = motion_of_keys(motion.at(region.of_all), region.keys - region.first, region.frames), None
    known = np.isin(np.arange(region.frames), region.keys - region.first)
    fills = filler.fills(skeleton, given, known, fixed)
    rows = request.key_rows[region.of_all]
    made = []
    for filled in fills:
        speeds = sentences_of_speed(skeleton, filled.motion, region.keys - region.first, region.first)
        data, losses = file.written(
            filled.motion, region.first, region.keys, rows, request.kept, request.frames, parts
        )
        said = (*notes, *asked_notes, *speeds, *losses)
        made.append(FilledFile(data, request, region, skeleton, filled, said))
    return made


def _in_format_of(output: Path, file: RowFile, made: FilledFile) -> tuple[bytes, list[str]]:
    """The filled file as it is, or what `pumps export` makes of it where the output is of another format."""
    if output.suffix.lower() == file.suffix:
        return made.data, []
    skeleton, motion = file.motion_in(made.data)
    return bytes_of_motion(written_format(output), skeleton, motion, output.stem)


def _region_of(request: Request, window: int, fps: float) -> Region:
    """Keys further from every missing frame than the models see in one window change nothing: leave them out."""
    reach = int(np.ceil(window * fps / MODEL_FPS))
    missing = request.missing
    keys = request.keys
    low = max(int(np.searchsorted(keys, missing[0] - reach)), 0)
    low = min(low, int(np.searchsorted(keys, missing[0])) - 1)
    after = int(np.searchsorted(keys, missing[-1]))
    high = min(max(int(np.searchsorted(keys, missing[-1] + reach, side="right")), after + 1), len(keys))
    of_all = np.arange(low, high)
    last = max(int(keys[high - 1]), int(missing[-1]))
    return Region(int(keys[low]), last - int(keys[low]) + 1, keys[of_all], of_all)


def _report(config: Config, made: FilledFile, filler: Filler, losses: list[str], seconds: float) -> StageReport:
    request, region, skeleton, filled = made.request, made.region, made.skeleton, made.filled
    missing = request.missing
    fallbacks = fallbacks_of(skeleton, filled.plain, region.first, missing - region.first)
    warnings = [*made.notes, *request.notes, *losses, *warnings_of(skeleton, filled, filler.longest_gap)]
    frames = filled.jump_frames + region.first
    gap_s = filled.longest_gap_s
    gist = [f"Note: {note}" for note in warnings]
    gist.append(
        f"Filled {len(missing)} of {request.frames} frames from {counted(len(request.keys), 'key')} in "
        f"{seconds:.2f} s; the longest gap is {gap_s:.2f} s ({gap_s * filled.motion.fps:.0f} frames)."
    )
    lines = [*gist, *lines_of_fallbacks(fallbacks)]
    lines += lines_of_jumps(frames, filled.jumps_mps, filled.base_jumps_mps)
    lines.append(line_of_skate(filled, config.foot_lock))
    lines += lines_of_pins(filled)
    lines.append(f"Weights {filler.name}, licences: {licence_names(filler.licences)} ({filler.shown_by}).")
    figures = {
        "frames": request.frames,
        "filled": len(missing),
        "keys": len(request.keys),
        "longest_gap_s": gap_s,
        "seconds": seconds,
        "warnings": warnings,
        "fell_back": fallbacks,
        "velocity_jumps": [
            {"frame": int(f), "m_per_s": float(a), "plain_m_per_s": float(b)}
            for f, a, b in zip(frames, filled.jumps_mps, filled.base_jumps_mps, strict=True)
        ],
        "foot_skate_mps": None if np.isnan(filled.skate_mps) else filled.skate_mps,
        "plain_foot_skate_mps": None if np.isnan(filled.base_skate_mps) else filled.base_skate_mps,
        "points_stray_m": filled.wander_m,
        "pins_off_mm": {name: off * 1000 for name, off in filled.pins_off_m.items()},
        "licences": list(filler.licences),
        "trained_on": filler.trained_on,
    }
    return StageReport(output=config.output, lines=lines, gist=gist, figures=figures)
