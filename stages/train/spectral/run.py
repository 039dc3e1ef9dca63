"""`pumps train spectral`: mesh sequences in, the checkpoint of a network that predicts or completes them out."""

from __future__ import annotations

from data_schemas.mesh import MeshReader
from stages.shared.contract import StageReport
from stages.shared.meshes.spectral_basis import SpectralBasis, spectral_basis
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import Trained, train
from stages.shared.training.stage import data_of, finish
from stages.train.spectral.config import Config
from stages.train.spectral.task import JointTask, SpectralTask
from stages.train.spectral.windows import mesh_windows


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the network.

    Raises: InputError for a bad mesh artefact, clips that are all too short, or more eigenvectors than vertices;
        PumpsError if the loss is not a number.
    """
    check_artefact(config, "checkpoint")
    device = choose_device(config.device)
    with MeshReader(config.mesh) as reader:
        topology = reader.topology
        basis, notes = None, []
        if config.method == "spectral":
            progress.start("finding the spectral basis")
            basis, graph = spectral_basis(topology.faces, topology.count, config.eigenvectors)
            notes = graph.notes()
        progress.start("reading windows")
        windows = mesh_windows(reader, basis, config.window, config.stride)
        if windows.training.short:
            notes.append(f"{windows.training.short} training clips are shorter than a window and are not used.")
        if basis is not None:
            task = SpectralTask(config, windows, basis, topology.faces, device)
        else:
            task = JointTask(config, windows, device)
        trained = train(task, config, progress=progress)
        if basis is not None and trained.finished:
            _add_basis(trained, basis)
        report = finish(
            config,
            trained,
            stage="train-spectral",
            network=_network(config, reader, basis),
            data=data_of(reader),
            inputs=[reader.artefact],
        )
    return report.model_copy(update={"lines": [*report.lines, *notes]})


def _add_basis(trained: Trained, basis: SpectralBasis) -> None:
    trained.weights["basis.vectors"], trained.weights["basis.values"] = basis.vectors, basis.values


def _network(config: Config, reader: MeshReader, basis: SpectralBasis | None) -> dict:
    """What a reader of the checkpoint needs to build the network."""
    shared = {"connectivity": reader.connectivity, "known": config.known, "task": config.task}
    shared["fps"] = sorted({row.fps for row in reader.clips})
    if basis is None:
        names = list(reader.topology.joints.names)
        return {"network": "joint-mlp", "sizes": config.joint_network.model_dump(), "joints": names, **shared}
    return {
        "network": "spectral",
        "sizes": config.network.model_dump(mode="json"),
        "eigenvectors": basis.size,
        **shared,
    }
