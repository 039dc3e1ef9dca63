"""`pumps sample-tpc`: motions to temporal point clouds, stored as bones' transforms or, baked, as positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial

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
from stages.shared.pools import all_results, cluster_or_none
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
        rows, bodies, rigs = _chosen(reader, config)
        for name, body in bodies.items():
            if not config.bake:
                writer.add_bones(body.bones, name)
        progress.start("Sampling clouds", total=len(rows))
        here = partial(sampled_clip, reader, bodies, rigs, config)
        elsewhere = partial(_sampled_elsewhere, config, artefact.manifest.digest)
        with cluster_or_none(config.cluster) as pool:
            sampled = all_results(pool, here if pool is None else elsewhere, [row.clip for row in rows])
            for row, found in zip(rows, sampled, strict=True):
                for made in found:
                    if made.points is not None:
                        writer.add_dense(made.row, made.points, _point_groups(bodies[made.body]))
                    else:
                        writer.add_rigid(made.row, made.heads, made.rotations)
                    frames += made.row.frames
                    clips += 1
                carried += len(found) - 1
                progress.advance(1, row.clip)
        draft.summary |= {"clips": clips, "frames": frames, "points": config.points, "on_other_rigs": carried}
    layout = "baked positions" if config.bake else "bones' transforms" + (", packed" if config.pack else "")
    lines = [f"{clips} clips, {frames} frames at {config.fps:g} fps, {config.points} points, {layout}."]
    if config.mixed_rigs:
        lines.append(f"{carried} of them are training clips on another rig of the collection.")
    figures = {"clips": clips, "frames": frames, "skeletons": len(bodies), "on_other_rigs": carried}
    return StageReport(output=config.output, lines=lines, figures=figures)


@dataclass(frozen=True)
class SampledClip:
    """A clip at the rate asked for, on the body of the name `body`: heads (T, B, 3) metres and rotations (T, B, 4) of
    its bones, or, baked, points (T, P, 3)."""

    row: ClipRow
    body: str
    heads: np.ndarray
    rotations: np.ndarray
    points: np.ndarray | None


def sampled_clip(
    reader: MotionReader, bodies: Mapping[str, _Body], rigs: Rigs, config: Config, clip: str
) -> list[SampledClip]:
    """A clip, and the same on other rigs of the collection where it is chosen for that."""
    row, motion = reader.row(clip), reader.motion(clip)
    others = on_another_rig(reader, row, motion, rigs, config.seed, config.mixed_rigs) if row.split == "train" else ()
    return [
        _sampled(config, here, reader.skeleton(here.skeleton), moved, bodies[here.skeleton])
        for here, moved in ((row, motion), *others)
    ]


def _sampled(config: Config, row: ClipRow, skeleton: Skeleton, motion: Motion, body: _Body) -> SampledClip:
    motion = resample(motion, config.fps)
    made = replace(row, frames=motion.frames, fps=config.fps, seconds=motion.frames / config.fps)
    heads = positions_of(skeleton, motion)[:, body.joints]
    rotations = motion.rotations[:, body.joints]
    points = place_points(body.bones, heads, rotations, config.sigma_m) if config.bake else None
    return SampledClip(replace(made, skeleton="") if config.bake else made, row.skeleton, heads, rotations, points)


def _sampled_elsewhere(config: Config, digest: str, clip: str) -> list[SampledClip]:
    """`sampled_clip` in another process, which keeps the artefact of that digest open for further clips."""
    return sampled_clip(*_opened(config.model_dump_json(), digest), config, clip)


@lru_cache(maxsize=1)
def _opened(settings: str, digest: str) -> tuple[MotionReader, Mapping[str, _Body], Rigs]:
    """Of a config as JSON; `digest` is that of its motion artefact."""
    config = Config.model_validate_json(settings)
    reader = MotionReader(config.motion)
    _, bodies, rigs = _chosen(reader, config)
    return reader, bodies, rigs


def _chosen(reader: MotionReader, config: Config) -> tuple[tuple[ClipRow, ...], dict[str, _Body], Rigs]:
    """The clips to sample, the bodies of all skeletons that are used, and the rigs that training clips are put on."""
    chosen = clips_where(reader.clips, config.where)
    rows = config.share_of(chosen)
    # Neither a clip nor a rig that is held out of training is used.
    training = [row for row in chosen if row.split == "train"] if config.mixed_rigs else []
    rigs = rigs_of(reader, training) if training else Rigs({}, {})
    names = sorted({*(row.skeleton for row in rows), *rigs.skeletons})
    bodies = {name: _Body(*bone_set(reader.skeleton(name), config.points, config.seed)) for name in names}
    return rows, bodies, rigs


def _point_groups(body: _Body) -> np.ndarray:
    return body.bones.groups[body.bones.point_bones]
