"""`pumps refine` mends the flawed frames of a motion of a known action."""

from __future__ import annotations

import time

import numpy as np
from scipy.interpolate import CubicSpline

from data_schemas.errors import InputError
from data_schemas.notes import sentences_of
from stages.refine.config import Config
from stages.shared.concepts.body_positions import Body, body_of, body_positions
from stages.shared.concepts.posing import follow_positions
from stages.shared.concepts.sequences import LEAST_FRAMES
from stages.shared.contract import StageReport
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.skeleton_map import choose_map, read_skeleton_map
from stages.shared.formats.sources import source_named
from stages.shared.formats.writers import SUFFIXES, bytes_of_motion, written_format
from stages.shared.inference.refining import ConceptModel, Refinement, load_concepts, refine
from stages.shared.kinematics.resampling import resample
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import SILENT, Progress

_SHOWN = 12  # anchors in the lines


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Refine a motion.

    Raises: UsageError for an action that was not learned; InputError for a bad file, another rig than the weights',
        or a clip that is too short.
    """
    started = time.perf_counter()
    check_file(config, SUFFIXES.values())
    if config.table is not None:
        check_file(config, (".csv",), "table")
    progress.start("refining", 3)
    model = load_concepts(config.weights, config.device)
    model.action(config.action)
    recording = _recording(config)
    skeleton, motion = recording.skeleton, recording.motion
    body = body_of(skeleton)
    _check_rig(model, body, config)
    progress.advance(note="read")
    slow = resample(motion, model.fps)
    if slow.frames < LEAST_FRAMES:
        raise InputError(
            f"{config.input} has {slow.frames} frames at the {model.fps:g} a second that the networks read, and "
            f"{LEAST_FRAMES} are the fewest.",
            "Give a longer clip.",
        )
    given = body_positions(skeleton, slow, body) * body.scale
    found = refine(model, given, config.action, only=config.only, seed=config.seed)
    moved = (found.positions - given) / body.scale
    targets = body_positions(skeleton, motion, body) + _at_rate(moved, model.fps, motion.frames, motion.fps)
    made = follow_positions(skeleton, motion, body, targets)
    progress.advance(note="refined")
    data, losses = bytes_of_motion(written_format(config.output), skeleton, made, config.output.stem)
    write_output(config.output, data)
    rows = _rows(found, np.linalg.norm(moved, axis=-1).mean(axis=1), motion.fps / model.fps, model.fps)
    if config.table is not None:
        write_output(config.table, _csv(rows))
    progress.advance(note="written")
    notes = [*sentences_of(recording.notes), *losses]
    flawed = int(found.flawed.sum())
    mean_mm = float(1000 * np.linalg.norm(moved, axis=-1).mean())
    lines = [
        *[f"Note: {note}" for note in notes],
        f"{flawed} of {len(found.anchors)} anchors were judged flawed; joints moved by {mean_mm:.1f} mm (mean), in "
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
        figures={"anchors": rows, "flawed": flawed, "moved_mm": mean_mm, "notes": notes},
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


def _check_rig(model: ConceptModel, body: Body, config: Config) -> None:
    if body.names != model.names or (body.parents != model.parents).any():
        raise InputError(
            f"{config.input} is on another rig ({len(body.names)} joints, {body.names[0]} ...) than the weights were "
            f"trained on ({len(model.names)} joints, {model.names[0]} ...).",
            "Put it on that rig first: pumps retarget IN --to RIG.bvh -o OUT.bvh.",
        )


def _at_rate(moved: np.ndarray, fps: float, frames: int, target_fps: float) -> np.ndarray:
    """Displacements (T, J, 3) resampled to `frames` frames of another rate; later frames keep the last
    displacement."""
    times = np.minimum(np.arange(frames) / target_fps, (len(moved) - 1) / fps)
    return CubicSpline(np.arange(len(moved)) / fps, moved, axis=0)(times)


def _rows(found: Refinement, moved: np.ndarray, ratio: float, fps: float) -> list[dict]:
    """One mapping an anchor; `moved` (T,) metres of each frame at the networks' rate."""
    return [
        {
            "frame": round(int(frame) * ratio), "seconds": int(frame) / fps, "score": float(score),
            "flawed": bool(flaw), "concept": int(concept), "moved_mm": float(1000 * moved[frame]),
        }
        for frame, score, flaw, concept in zip(found.anchors, found.scores, found.flawed, found.concepts, strict=True)
    ]  # fmt: skip


def _csv(rows: list[dict]) -> bytes:
    heads = list(rows[0])
    lines = [
        ",".join(heads),
        *(",".join(f"{value:g}" for value in row.values()) for row in rows),
    ]
    return ("\n".join(lines) + "\n").encode()
