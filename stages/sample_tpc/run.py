"""`pumps sample-tpc`: motions to temporal point clouds, stored as bones' transforms or, baked, as positions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.clip_filter import clips_where
from data_schemas.clips import ClipRow
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.tpc import BoneSet, TpcWriter, place_points
from stages.sample_tpc.config import Config
from stages.shared.contract import StageReport
from stages.shared.humanoid.other_rigs import Rigs, on_another_rig, rigs_of
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.resampling import resample
from stages.shared.outputs import check_artefact
from stages.shared.pointcloud.bones import bone_set
from stages.shared.progress import SILENT, Progress


@dataclass(frozen=True)
class _Body:
    """A skeleton's bone set under its own id, and the joints that the bones are."""

    bones: BoneSet
    joints: np.ndarray


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the tpc artefact `config.output` of the motion artefact `config.motion`.

    Points are drawn once for each skeleton, from the seed alone: the order of clips means nothing.
    Raises: InputError where the motion artefact is missing, damaged or empty; UsageError for an expression that no
        clip satisfies, or a part that cannot be.
    """
    check_artefact(config, "tpc")
    artefact = open_artefact(config.motion, "motion")
    frames = clips = carried = 0
    with (
        MotionReader(artefact) as reader,
        write_artefact(config.output, "tpc", stage="sample-tpc", config=config, inputs=[artefact]) as draft,
        TpcWriter(draft.folder, packed=config.pack) as writer,
    ):
        chosen = clips_where(reader.clips, config.where)
        rows = config.share_of(chosen)
        # Neither a clip nor a rig that is held out of training is used.
        training = [row for row in chosen if row.split == "train"] if config.mixed_rigs else []
        rigs = rigs_of(reader, training) if training else Rigs({}, {})
        bodies = {}
        for name in sorted({*(row.skeleton for row in rows), *rigs.skeletons}):
            bodies[name] = _Body(*bone_set(reader.skeleton(name), config.points, config.seed))
            if not config.bake:
                writer.add_bones(bodies[name].bones, name)
        progress.start("Sampling clouds", total=len(rows))
        for row in rows:
            motion = reader.motion(row.clip)
            others = (
                on_another_rig(reader, row, motion, rigs, config.seed, config.mixed_rigs)
                if row.split == "train"
                else ()
            )
            for here, moved in ((row, motion), *others):
                frames += _add(writer, config, here, reader.skeleton(here.skeleton), moved, bodies[here.skeleton])
                clips += 1
                carried += here is not row
            progress.advance(1, row.clip)
        draft.summary |= {"clips": clips, "frames": frames, "points": config.points, "on_other_rigs": carried}
    layout = "baked positions" if config.bake else "bones' transforms" + (", packed" if config.pack else "")
    lines = [f"{clips} clips, {frames} frames at {config.fps:g} fps, {config.points} points, {layout}."]
    if config.mixed_rigs:
        lines.append(f"{carried} of them are training clips on another rig of the collection.")
    figures = {"clips": clips, "frames": frames, "skeletons": len(bodies), "on_other_rigs": carried}
    return StageReport(output=config.output, lines=lines, figures=figures)


def _add(writer: TpcWriter, config: Config, row: ClipRow, skeleton: Skeleton, motion: Motion, body: _Body) -> int:
    """Store one clip at the rate asked for; returns its number of frames there."""
    motion = resample(motion, config.fps)
    row = replace(row, frames=motion.frames, fps=config.fps, seconds=motion.frames / config.fps)
    heads = positions_of(skeleton, motion)[:, body.joints]
    rotations = motion.rotations[:, body.joints]
    if config.bake:
        points = place_points(body.bones, heads, rotations, config.sigma_m)
        writer.add_dense(replace(row, skeleton=""), points, body.bones.groups[body.bones.point_bones])
    else:
        writer.add_rigid(row, heads, rotations)
    return motion.frames
