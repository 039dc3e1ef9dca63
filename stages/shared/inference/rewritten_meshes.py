"""A mesh artefact that is made of another one by trained networks: the same connectivity and bodies, other clips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from data_schemas.artefact import Draft, write_artefact
from data_schemas.clip_filter import clips_where
from data_schemas.clips import ClipRow
from data_schemas.mesh import MeshReader, MeshWriter
from stages.shared.contract import WritingConfig
from stages.shared.inference.spectral import SpectralWeights
from stages.shared.meshes.linear_views import LinearView


@dataclass(frozen=True)
class RewrittenMeshes:
    """The artefact that is read, its chosen clips and their coefficients, and the one that is written."""

    reader: MeshReader
    rows: Sequence[ClipRow]
    view: LinearView
    draft: Draft
    writer: MeshWriter


@contextmanager
def rewritten_meshes(
    mesh: Path,
    output: Path,
    weights: SpectralWeights,
    name: str,
    where: str | None,
    stage: str,
    config: WritingConfig,
) -> Iterator[RewrittenMeshes]:
    """Open an artefact, and write another one with its bodies.

    Args:
        name: of the weights, for errors. where: which clips. stage, config: for the manifest.

    Raises: InputError for meshes of another connectivity than the weights'.
    """
    with MeshReader(mesh) as reader:
        reader.check_connectivity(weights.connectivity, name)
        rows = clips_where(reader.clips, where)
        view, inputs = LinearView(reader, weights.basis.vectors.T), [reader.artefact, weights.artefact]
        with (
            write_artefact(output, "mesh", stage=stage, config=config, inputs=inputs) as draft,
            MeshWriter(draft.folder, reader.topology) as writer,
        ):
            for body in reader.bodies():
                writer.add_body(body, reader.body(body))
            yield RewrittenMeshes(reader, rows, view, draft, writer)
