"""`pumps skin --body-models`: the surfaces of parameters of SMPL's bodies."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import names_artefact
from data_schemas.mesh import MeshWriter
from data_schemas.skeleton import Motion
from data_schemas.skinned_body import Body
from stages.shared.contract import StageReport
from stages.shared.formats.amass import SmplParameters, smpl_parameters
from stages.shared.formats.clip_names import ClipNames
from stages.shared.formats.sources import find_sources
from stages.shared.formats.splits import assign_splits
from stages.shared.kinematics.resampling import resample
from stages.shared.meshes.smpl_bodies import SmplModel, load_smpl
from stages.shared.progress import Progress
from stages.skin.config import Config

_NEUTRAL = "neutral"
_FINGERS_FROM = 3 * 22  # numbers of a pose before those of hands and face


@dataclass
class _Wardrobe:
    """Models by layout and gender, and the names of the bodies that are stored."""

    folder: Path
    models: dict[tuple[str, str], SmplModel] = field(default_factory=dict)
    bodies: dict[tuple[str, str, bytes], str] = field(default_factory=dict)

    def model(self, layout: str, gender: str) -> SmplModel:
        key = (layout, gender)
        if key not in self.models:
            self.models[key] = load_smpl(self.folder, layout, gender)
        return self.models[key]

    def body(self, writer: MeshWriter, model: SmplModel, given: SmplParameters) -> str:
        """The name of the parameters' body, which is stored where it is new."""
        key = (given.layout, given.gender or _NEUTRAL, np.asarray(given.betas, np.float64).tobytes())
        if key not in self.bodies:
            self.bodies[key] = f"body-{len(self.bodies)}"
            shape = {f"beta_{number}": float(value) for number, value in enumerate(given.betas)}
            writer.add_body(self.bodies[key], Body(model.shaped(given.betas), np.zeros((0, 3)), shape))
        return self.bodies[key]


def skin_smpl(config: Config, progress: Progress) -> StageReport:
    """Write the mesh artefact of one file, folder or archive of parameters.

    A file that cannot be read, whose model is not there or whose model has other triangles is reported and left out.
    Raises: UsageError for options of other bodies; PumpsError without the package smplx; InputError if no file is
        left.
    """
    assert config.body_models is not None
    if config.bodies is not None or config.where is not None or names_artefact(config.input):
        raise UsageError(
            "--body-models puts files of SMPL's parameters on SMPL's bodies: give neither --bodies nor --where nor "
            "an artefact.",
            "Give the .npz files, their folder or archive.",
        )
    sources = find_sources([str(config.input)], (".npz",))
    assigned = assign_splits(sources, config.splits)
    wardrobe, names = _Wardrobe(config.body_models), ClipNames()
    left: list[str] = []
    frames = clips = 0
    licence, dtype = config.licence or "unknown", np.float16 if config.store == "float16" else np.float32
    inputs = [config.input, *([config.splits] if config.splits is not None else [])]
    progress.start("Computing surfaces", total=len(sources))
    with (
        write_artefact(config.output, "mesh", stage="skin", config=config, inputs=_files(inputs)) as draft,
        ExitStack() as opened,
    ):
        writer: MeshWriter | None = None
        for source in sources:
            progress.advance(1, source.member)
            if source.name not in assigned.splits:
                continue
            try:
                data = source.read()
                parameters = _shown(config, smpl_parameters(data, source.name))
                model = wardrobe.model(parameters.layout, parameters.gender or _NEUTRAL)
                if writer is None:
                    writer = opened.enter_context(MeshWriter(draft.folder, model.topology))
                elif not np.array_equal(model.faces, writer.topology.faces):
                    raise InputError(f"{model.path} has other triangles than the model of the first file.")
            except InputError as error:
                left.append(f"left out: {source.name}: {error}")
                continue
            taken = len(parameters.vectors)
            row = ClipRow(
                clip=names.name(source), source=source.name, sha256=hashlib.sha256(data).hexdigest(),
                skeleton=wardrobe.body(writer, model, parameters), frames=taken, fps=config.fps,
                seconds=taken / config.fps, split=assigned.splits[source.name], licence=licence,
            )  # fmt: skip
            writer.add_dense(row, _placed(model, parameters, removed=config.root == "removed"), dtype)
            draft.licences.add(licence)
            frames, clips = frames + row.frames, clips + 1
        if writer is None:
            why = f"The first: {left[0]}" if left else "No file is in a split."
            raise InputError(f"Nothing of {config.input} could be used. {why}")
        figures = {"clips": clips, "frames": frames, "identities": len(wardrobe.bodies), "left_out": len(left)}
        draft.summary |= figures
    hours = frames / config.fps / 3600
    said = (
        f"{clips} clips, {frames} frames ({hours:.2f} hours) on {len(wardrobe.bodies)} of SMPL's bodies, "
        f"{writer.topology.count} vertices."
    )
    return StageReport(
        output=config.output, lines=[said, *assigned.notes, *left], figures={**figures, "hours": hours}
    )


def _files(inputs: Sequence[Path]) -> list[Path]:
    """The inputs that are files: a folder of recordings has no digest of its own."""
    return [path for path in inputs if path.is_file()]


def _shown(config: Config, given: SmplParameters) -> SmplParameters:
    """The parameters with the rate, the root and the shape that the config asks for; `mean` has flat hands."""
    turns = Rotation.from_rotvec(given.vectors.reshape(-1, 3).astype(np.float64)).as_quat()
    local = turns.reshape(len(given.vectors), -1, 4).astype(np.float32)
    motion = resample(Motion(local, given.trans.astype(np.float32), given.fps), config.fps)
    vectors = Rotation.from_quat(motion.rotations.reshape(-1, 4)).as_rotvec().reshape(motion.frames, -1)
    trans, betas, gender = motion.root_positions, given.betas, given.gender
    if config.root == "removed":
        vectors[:, :3], trans = 0, np.zeros_like(trans)
    if config.shape == "mean":
        vectors[:, _FINGERS_FROM:], betas, gender = 0, np.zeros(0), _NEUTRAL
    return SmplParameters(given.layout, vectors, trans, config.fps, betas, gender, given.up_axis)


def _placed(model: SmplModel, given: SmplParameters, *, removed: bool) -> Iterator[np.ndarray]:
    """Vertices (t, N, 3), Y up. A body without its root stands as the model does, which is Y up."""
    at = 0
    for part in model.vertices(given.vectors, given.betas):
        made = part + given.trans[at : at + len(part), None]
        if not removed and given.up_axis == "z":
            made = made[..., [0, 2, 1]] * np.array([1, 1, -1], np.float32)
        yield made.astype(np.float32)
        at += len(part)
