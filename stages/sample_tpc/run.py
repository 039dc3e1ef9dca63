"""`pumps sample-tpc`: motions to temporal point clouds, stored as bones' transforms or, baked, as positions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.clip_filter import clips_where
from data_schemas.motion import MotionReader
from data_schemas.tpc import BoneSet, TpcWriter, place_points
from stages.config import StageReport
from stages.kinematics.forward import positions_of
from stages.kinematics.resampling import resample
from stages.pointcloud.bones import bone_set
from stages.progress import SILENT, Progress
from stages.sample_tpc.config import Config


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
    artefact = open_artefact(config.motion, "motion")
    frames = 0
    with (
        MotionReader(artefact) as reader,
        write_artefact(config.output, "tpc", stage="sample-tpc", config=config, inputs=[artefact]) as draft,
        TpcWriter(draft.folder) as writer,
    ):
        rows = config.share_of(clips_where(reader.clips, config.where))
        bodies = {}
        for name in sorted({row.skeleton for row in rows}):
            bodies[name] = _Body(*bone_set(reader.skeleton(name), config.points, config.seed))
            if not config.bake:
                writer.add_bones(bodies[name].bones, name)
        progress.start("Sampling clouds", total=len(rows))
        for row in rows:
            body = bodies[row.skeleton]
            motion = resample(reader.motion(row.clip), config.fps)
            here = replace(row, frames=motion.frames, fps=config.fps, seconds=motion.frames / config.fps)
            heads = positions_of(reader.skeleton(row.skeleton), motion)[:, body.joints]
            rotations = motion.rotations[:, body.joints]
            if config.bake:
                points = place_points(body.bones, heads, rotations, config.sigma_m)
                writer.add_dense(replace(here, skeleton=""), points, body.bones.groups[body.bones.point_bones])
            else:
                writer.add_rigid(here, heads, rotations)
            frames += motion.frames
            progress.advance(1, row.clip)
        draft.summary |= {"clips": len(rows), "frames": frames, "points": config.points}
    layout = "baked positions" if config.bake else "bones' transforms"
    line = f"{len(rows)} clips, {frames} frames at {config.fps:g} fps, {config.points} points, {layout}."
    figures = {"clips": len(rows), "frames": frames, "skeletons": len(bodies)}
    return StageReport(output=config.output, lines=[line], figures=figures)
