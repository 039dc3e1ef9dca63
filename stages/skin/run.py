"""`pumps skin`: motions on bodies, as mesh sequences of one connectivity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import Artefact
from data_schemas.mesh import MeshReader, MeshWriter
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
from stages.skin.smpl import skin_smpl

_MOST_FITTED = 24  # identities that the joint regressor is exact on
_FRAMES_AT_ONCE = 32


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the mesh artefact `config.output` of the motions `config.input`.

    A clip whose skeleton cannot be put on the body is reported and left out.
    Raises: UsageError for options that do not go together; PumpsError without the package anny, or smplx for SMPL's
        bodies; InputError if no clip could be used, or for damaged input.
    """
    check_artefact(config, "mesh")
    if config.body_models is not None:
        return skin_smpl(config, progress)
    if config.splits is not None:
        raise UsageError("--splits is for --body-models.", "Give it to `pumps ingest`, or leave it out.")
    progress.start("Loading the body model")
    wardrobe = _of_artefact(config.bodies, config.identities) if config.bodies is not None else _of_anny(config)
    bodies, skin = wardrobe.bodies, wardrobe.topology.skin
    assert skin is not None
    rigs = {name: rig_of_body(skin, body) for name, body in bodies.items()}
    topology = wardrobe.topology
    if not topology.joints.names:
        topology = _with_joints(topology, list(bodies.values()), next(iter(rigs.values())))
    lines: list[str] = []
    frames = clips = 0
    with opened_motions(config) as motions:
        inputs = [motions.artefact] if motions.artefact is not None else [config.input]
        with (
            write_artefact(
                config.output,
                "mesh",
                stage="skin",
                config=config,
                inputs=[*inputs, *wardrobe.inputs],
                licences=wardrobe.licences,
            ) as draft,
            MeshWriter(draft.folder, topology) as writer,
        ):
            for name, body in bodies.items():
                writer.add_body(name, body)
            worn = np.random.default_rng((config.seed, 1)).choice(list(bodies), size=len(motions.rows))
            progress.start("Putting motions on bodies", total=len(motions.rows))
            for row, name, (source, motion) in zip(motions.rows, worn.tolist(), motions.each, strict=True):
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


@dataclass(frozen=True)
class _Wardrobe:
    """Bodies to wear, by id, and where they are from."""

    topology: Topology
    bodies: dict[str, Body]
    inputs: tuple[Artefact, ...] = ()
    licences: tuple[str, ...] = ()


def _of_anny(config: Config) -> _Wardrobe:
    model = load_anny()
    shapes = draw_shapes(config.identities, config.seed)
    bodies = {f"body-{number}": model.body(shape) for number, shape in enumerate(shapes)}
    return _Wardrobe(model.topology, bodies, licences=(LICENCE,))


def _of_artefact(path: Path, count: int) -> _Wardrobe:
    with MeshReader(path) as reader:
        if reader.topology.skin is None or not reader.bodies():
            raise InputError(f"{path} holds no bodies with bones.", "Give what `pumps skin` wrote.")
        bodies = {name: reader.body(name) for name in reader.bodies()[:count]}
        return _Wardrobe(reader.topology, bodies, (reader.artefact,))


def _with_joints(topology: Topology, bodies: list[Body], rig: BodyRig) -> Topology:
    """The topology with the regressor of the joints of the body; fingers have none."""
    assert topology.skin is not None
    bones = [bone for bone, joint in enumerate(rig.joints) if rig.skeleton.sampled[joint]]
    fitted = bodies[:_MOST_FITTED]
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
