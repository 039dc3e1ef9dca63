"""`pumps segment` finds the anchor frames of motions, the splines between them, and anchor concepts."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.concepts import ConceptsWriter, SegmentedClip
from data_schemas.errors import InputError, UsageError
from stages.segment.config import Config
from stages.segment.inputs import Given, given
from stages.shared.concepts.clusters import AnchorConcepts, cluster_actions
from stages.shared.concepts.data_sets import LabelledPositions
from stages.shared.concepts.segmenting import fit_error_cm, segmented
from stages.shared.contract import StageReport
from stages.shared.kinematics.spline_segments import CUBIC
from stages.shared.outputs import check_artefact, check_file, write_output
from stages.shared.progress import SILENT, Progress


@dataclass(frozen=True)
class _Clip:
    given: LabelledPositions
    found: SegmentedClip


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Segment motions; write the artefact, or print the anchors.

    Raises: UsageError for options that contradict each other; InputError for a bad input, or one without a humanoid.
    """
    started = time.perf_counter()
    _check(config)
    motions = given(config)
    if config.keyframes and motions.count > 1:
        raise UsageError(f"{config.input} holds several clips.", "Export one first: pumps export FILE --clip NAME.")
    progress.start("segmenting", motions.count)
    if config.output is None:
        clips = list(_segmented(motions, config, progress))
        return _report_of_one(config, clips[0], time.perf_counter() - started)
    with write_artefact(config.output, "concepts", stage="segment", config=config, inputs=motions.inputs) as draft:
        clips = list(_segmented(motions, config, progress))
        concepts = _clustered(config, clips)
        with ConceptsWriter(draft.folder, config.lambda_) as writer:
            for clip in clips:
                writer.add_body(clip.given.body)
                labels = concepts.labels.get(clip.given.row.clip)
                found = clip.found if labels is None else replace(clip.found, clusters=labels)
                writer.add(clip.given.row, found)
            for action, centres in concepts.centres.items():
                writer.add_centres(action, centres)
        report = _report(config, clips, concepts, time.perf_counter() - started)
        draft.summary.update(report.figures)
        draft.licences |= {clip.given.row.licence for clip in clips}
    if config.page is not None:
        from stages.segment.page import page_of  # t-SNE is slow to load

        write_output(config.page, page_of([(c.given.row, c.given.body, c.found) for c in clips], concepts, config))
        report.lines.append(f"{config.page} shows the anchor concepts.")
    return report


def _check(config: Config) -> None:
    if config.output is None and not config.keyframes:
        raise UsageError("Nothing is asked for.", "Give -o FOLDER for the artefact, or --keyframes for a list.")
    if config.keyframes and (config.output is not None or config.fps is not None or config.data_set is not None):
        raise UsageError(
            "--keyframes prints the anchors of one file as it is.", "Leave -o, --fps and --data-set out."
        )
    if config.data_set is not None and config.fps is not None:
        raise UsageError("--data-set keeps the rate of the data set.", "Leave --fps out.")
    if config.page is not None and (config.output is None or config.cluster == "none"):
        raise UsageError("--page shows anchor concepts.", "Give -o and --cluster kmeans with it.")
    if config.clusters is not None and config.cluster not in ("kmeans", "ward"):
        raise UsageError("--clusters is for --cluster kmeans and ward.", "Leave it out, or choose one of them.")
    if config.output is not None:
        check_artefact(config, "concepts")
    if config.page is not None:
        check_file(config, (".html",), "page")


def _segmented(motions: Given, config: Config, progress: Progress) -> Iterator[_Clip]:
    degree = config.degree or (1 if config.keyframes else CUBIC)
    for clip in motions.clips:
        found = segmented(
            clip.positions, clip.scale, clip.row.fps, config.lambda_, config.longest_s, clip.action, degree
        )
        progress.advance(1, clip.row.clip)
        yield _Clip(clip, found)


def _clustered(config: Config, clips: list[_Clip]) -> AnchorConcepts:
    if config.cluster == "none":
        return AnchorConcepts({}, {}, {})
    bodies = {clip.given.body.id for clip in clips}
    if len(bodies) > 1:
        raise InputError(
            f"{config.input} holds {len(bodies)} different sets of joints, and anchor concepts are of one.",
            "Put the motions on one rig first: pumps data rerig.",
        )
    if not any(clip.given.action for clip in clips):
        raise InputError(
            f"No clip of {config.input} has a known action.", "Say where it is in the file names: --actions REGEX."
        )
    return cluster_actions(
        [(clip.given.row, clip.found) for clip in clips], clips[0].given.body, config.cluster, config.clusters,
        config.seed,
    )  # fmt: skip


def _report_of_one(config: Config, clip: _Clip, seconds: float) -> StageReport:
    anchors = clip.found.anchors
    return StageReport(
        lines=[",".join(str(frame) for frame in anchors.tolist())],
        figures={
            "keyframes": anchors.tolist(), "frames": len(clip.found.positions), "fps": clip.given.row.fps,
            "fit_error_cm": fit_error_cm(clip.found), "lambda": config.lambda_, "seconds": seconds,
            "notes": list(clip.given.notes),
        },
    )  # fmt: skip


def _report(config: Config, clips: list[_Clip], concepts: AnchorConcepts, seconds: float) -> StageReport:
    frames = np.array([len(clip.found.positions) for clip in clips])
    times = np.concatenate([np.diff(c.found.anchors) / c.given.row.fps for c in clips])
    error = float(np.average([fit_error_cm(clip.found) for clip in clips], weights=frames))
    actions: dict[str, int] = defaultdict(int)
    for clip in clips:
        actions[clip.given.action] += 1
    figures = {
        "clips": len(clips), "frames": int(frames.sum()), "transitions": len(times), "fit_error_cm": error,
        "median_transition_s": float(np.median(times)) if len(times) else 0.0,
        "actions": dict(sorted(actions.items())),
        "anchor_concepts": {action: len(centres) for action, centres in concepts.centres.items()},
        "silhouettes": concepts.silhouettes, "seconds": seconds,
    }  # fmt: skip
    unknown = actions.get("", 0)
    lines = [
        f"Segmented {len(clips)} clips of {frames.sum()} frames into {len(times)} transitions of "
        f"{figures['median_transition_s']:.2f} s (median), {error:.2f} cm from their splines, in {seconds:.1f} s."
    ]
    if unknown and config.cluster != "none":
        lines.append(f"{unknown} clips have no known action and no anchor concepts.")
    if concepts.centres:
        named = ", ".join(f"{action} {len(centres)}" for action, centres in sorted(concepts.centres.items()))
        lines.append(f"Anchor concepts: {named}.")
    return StageReport(output=config.output, lines=lines, figures=figures)
