"""One file edited: read, changed, written, reported. Every verb of `pumps edit` passes its change."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from data_schemas.errors import InputError
from stages.shared.contract import StageReport
from stages.shared.editing.bridging import Bridged
from stages.shared.editing.edited import Edited
from stages.shared.editing.mirror import Mirror
from stages.shared.editing.motion_files import MotionFile, motion_file
from stages.shared.editing.settings import EditConfig
from stages.shared.formats.recording import Asked
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.skeleton_map import read_skeleton_map
from stages.shared.formats.sources import source_named
from stages.shared.formats.writers import SUFFIXES
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import Progress
from stages.shared.statistics.tables import counted


@dataclass(frozen=True)
class Change:
    """What a verb made of a file.

    edited: the result. lines: sentences for the summary. figures: the same for programs.
    mirror: the mirror, if the whole motion was mirrored. file: the file in whose text the result is written, if that
        is not the input.
    """

    edited: Edited
    lines: list[str] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)
    mirror: Mirror | None = None
    file: MotionFile | None = None


def edit_file(config: EditConfig, change: Callable[[MotionFile], Change], progress: Progress) -> StageReport:
    """Read the input, change it, and write the output.

    Raises: UsageError for an output that exists or options that are not possible; InputError for a bad file.
    """
    started = time.perf_counter()
    check_file(config, SUFFIXES.values())
    progress.start("editing", 3)
    file = file_asked(config, config.input)
    progress.advance(note="read")
    made = change(file)
    progress.advance(note="changed")
    data, losses = (made.file or file).written(config.output, made.edited, mirror=made.mirror)
    write_output(config.output, data)
    progress.advance(note="written")
    notes = [*file.notes, *made.edited.notes, *losses]
    motion = made.edited.motion
    seconds = time.perf_counter() - started
    last = (
        f"Wrote {counted(motion.frames, 'frame')} at {motion.fps:g} a second ({motion.frames / motion.fps:.2f} s) "
        f"in {seconds:.2f} s; the input has {file.motion.frames} at {file.motion.fps:g}."
    )
    figures = {
        "frames": motion.frames,
        "fps": motion.fps,
        "input_frames": file.motion.frames,
        "input_fps": file.motion.fps,
        "kept_frames": int((made.edited.rows >= 0).sum()),
        "seconds": seconds,
        "notes": notes,
        **made.figures,
    }
    gist = [*[f"Note: {note}" for note in notes], *(made.lines or [last])]
    return StageReport(
        output=config.output, lines=[*gist, *([last] if made.lines else [])], gist=gist, figures=figures
    )


def file_asked(config: EditConfig, path: Path) -> MotionFile:
    """A file read as the config says. Raises InputError."""
    maps = (read_skeleton_map(config.skeleton_map),) if config.skeleton_map else ()
    rig, rig_name = rig_named(config.skeleton) if config.skeleton is not None else (b"", "")
    asked = Asked(
        fps_override=config.fps_override, rig=rig, rig_name=rig_name, skeleton_maps=maps, up_axis=config.up_axis
    )
    file = motion_file(source_named(str(path)), asked)
    if file.motion.frames == 0:
        raise InputError(f"{file.name} has no frame.")
    return file


def change_of_bridge(found: Bridged, fps: float, what: str, file: MotionFile | None = None) -> Change:
    """A bridge with what the summary says of it.

    Args:
        what: the bridge's purpose, such as "from the last pose to the first".
    """
    edited, seams = found.edited, found.seams
    count = int(edited.bridged.sum())
    lines = [*(f"Note: {speed}" for speed in found.speeds)]
    figures: dict[str, Any] = {
        "bridge_frames": count,
        "turn_degrees": _degrees(found.placement.yaw_rad),
        "shift_m": found.placement.shift.tolist(),
        "warnings": list(found.speeds),
        "seam_jumps_mps": seams.jumps_mps.tolist(),
        "bridge_jump_mps": seams.within_mps,
        "usual_jump_mps": seams.usual_mps,
        "high_jump_mps": seams.high_mps,
        "usual_speed_mps": seams.step_mps,
    }
    before, after = seams.jumps_mps
    usual = (
        f"(mean over the body's joints). In the clips it changes by {seams.usual_mps:.3f} m/s a frame on average and "
        f"by less than {seams.high_mps:.3f} in 95% of the frames, and the joints move at {seams.step_mps:.3f} m/s."
    )
    if count:
        lines.append(
            f"Filled {counted(count, 'frame')} ({count / fps:.2f} s) {what}. The velocity changes by {before:.3f} "
            f"m/s before them, {after:.3f} m/s after them, and {seams.within_mps:.3f} m/s a frame at most in them "
            + usual
        )
    else:
        lines.append(
            f"Filled no frame {what}. The velocity changes by {before:.3f} m/s in the last frame of the first and "
            f"{after:.3f} m/s in the first frame of the second " + usual
        )
    if seams.excess > 1:
        largest = max(before, after, seams.within_mps)
        lines.append(
            f"Note: The velocity changes by up to {largest / max(seams.usual_mps, 1e-9):.1f} times the mean of "
            "the clips there, which may show as a jerk. A longer --blend is smoother."
        )
    return Change(edited, lines, figures, file=file)


def trip_of(change: Change) -> tuple[float, float]:
    """Metres on the ground and degrees by which the clip after a bridge was moved."""
    shift = change.figures["shift_m"]
    return float(np.hypot(shift[0], shift[2])), change.figures["turn_degrees"]


def _degrees(radians: float) -> float:
    """An angle from -180 to 180 degrees."""
    return float((np.degrees(radians) + 180.0) % 360.0 - 180.0)
