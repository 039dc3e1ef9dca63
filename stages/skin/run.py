"""`pumps skin`: motions on bodies, as mesh sequences of one connectivity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.mesh import MeshWriter
from data_schemas.skinned_body import Body, Skin, Topology, skinned_vertices
from stages.shared.contract import StageReport
from stages.shared.kinematics.resampling import resample
from stages.shared.meshes.anny_bodies import LICENCE, draw_shapes, load_anny
from stages.shared.meshes.body_rig import BodyRig, put_on_body, rig_of_body
from stages.shared.meshes.joint_regressor import fit_joint_regressor
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.skin.clips import opened_motions
from stages.skin.config import Config

_MOST_FITTED = 24  # identities that the joint regressor is exact on
_FRAMES_AT_ONCE = 32


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the mesh artefact `config.output` of the motions `config.input`.

    A clip whose skeleton cannot be put on the body is reported and left out.
    Raises: PumpsError without the package anny; InputError if no clip could be used, or for damaged input.
    """
    check_artefact(config, "mesh")
    progress.start("Loading the body model")
    model = load_anny()
    shapes = draw_shapes(config.identities, config.seed)
    bodies = {f"body-{number}": model.body(shape) for number, shape in enumerate(shapes)}
    skin = model.topology.skin
    assert skin is not None
    rigs = {name: rig_of_body(skin, body) for name, body in bodies.items()}
    topology = _with_joints(model.topology, list(bodies.values()), next(iter(rigs.values())))
    lines: list[str] = []
    frames = clips = 0
    with opened_motions(config) as motions:
        inputs = [motions.artefact] if motions.artefact is not None else [config.input]
        with (
            write_artefact(
                config.output, "mesh", stage="skin", config=config, inputs=inputs, licences=[LICENCE]
            ) as draft,
            MeshWriter(draft.folder, topology) as writer,
        ):
            for name, body in bodies.items():
                writer.add_body(name, body)
            worn = np.random.default_rng((config.seed, 1)).integers(len(bodies), size=len(motions.rows))
            progress.start("Putting motions on bodies", total=len(motions.rows))
            for row, which, (source, motion) in zip(motions.rows, worn, motions.each, strict=True):
                name = f"body-{which}"
                motion = resample(motion, config.fps)
                try:
                    rotations, heads = put_on_body(source, motion, rigs[name])
                except InputError as error:
                    lines.append(f"left out: {row.clip}: {error}")
                    continue
                if config.root == "removed":
                    rotations, heads = rigs[name].without_root(rotations, heads)
                row = replace(
                    row, skeleton=name, frames=motion.frames, fps=config.fps, seconds=motion.frames / config.fps
                )
                _add(writer, config, row, skin, bodies[name], rotations, heads)
                draft.licences.add(row.licence)
                frames, clips = frames + motion.frames, clips + 1
                progress.advance(1, row.clip)
            if not clips:
                raise InputError(f"No clip of {config.input} could be put on a body. The first: {lines[0]}")
            draft.summary |= {"clips": clips, "frames": frames, "identities": len(bodies), "left_out": len(lines)}
    hours = frames / config.fps / 3600
    said = f"{clips} clips, {frames} frames ({hours:.2f} hours) on {len(bodies)} " + (
        "body" if len(bodies) == 1 else "bodies"
    )
    figures = {"clips": clips, "frames": frames, "hours": hours, "identities": len(bodies), "left_out": len(lines)}
    return StageReport(
        output=config.output,
        lines=[f"{said}, {topology.count} vertices, {len(topology.joints.names)} joints.", *lines],
        figures=figures,
    )


def _with_joints(topology: Topology, bodies: list[Body], rig: BodyRig) -> Topology:
    """The topology with the regressor of the joints of the body; fingers have none."""
    assert topology.skin is not None
    bones = [bone for bone, joint in enumerate(rig.joints) if rig.skeleton.sampled[joint]]
    fitted = bodies[: _MOST_FITTED]
    return replace(topology, joints=fit_joint_regressor(topology.skin, fitted, bones))


def _add(
    writer: MeshWriter, config: Config, row: ClipRow, skin: Skin, body: Body, rotations: np.ndarray, heads: np.ndarray
) -> None:
    if config.store == "bones":
        writer.add_skinned(row, rotations, heads)
        return

    def parts() -> Iterator[np.ndarray]:
        for start in range(0, row.frames, _FRAMES_AT_ONCE):
            some = slice(start, start + _FRAMES_AT_ONCE)
            yield skinned_vertices(skin, body, rotations[some], heads[some])

    writer.add_dense(row, parts(), np.float16 if config.store == "float16" else np.float32)
