"""`pumps complete-mesh`: one window of each mesh sequence, completed between its known frames and its last one."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import chain

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clip_filter import clips_where
from data_schemas.errors import InputError
from data_schemas.mesh import MeshReader, MeshWriter
from stages.complete_mesh.config import Config
from stages.shared.contract import StageReport
from stages.shared.inference.spectral import load_spectral, vertices_in_parts
from stages.shared.meshes.linear_views import LinearView
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the mesh artefact `config.output`.

    A clip that ends before the window does is reported and left out.
    Raises: InputError for weights of another task or connectivity, or if no clip is long enough.
    """
    check_artefact(config, "mesh")
    weights = load_spectral(config.weights, config.device)
    weights.check_task("complete")
    lines: list[str] = []
    clips, seconds = 0, 0.0
    known, last, stop = config.start + weights.known, config.start + weights.frames - 1, config.start + weights.frames
    with MeshReader(config.mesh) as reader:
        reader.check_connectivity(weights.connectivity, config.weights)
        rows = clips_where(reader.clips, config.where)
        view = LinearView(reader, weights.basis.vectors.T)
        inputs = [reader.artefact, weights.artefact]
        with (
            write_artefact(config.output, "mesh", stage="complete-mesh", config=config, inputs=inputs) as draft,
            MeshWriter(draft.folder, reader.topology) as writer,
        ):
            for name in reader.bodies():
                writer.add_body(name, reader.body(name))
            progress.start("Completing meshes", total=len(rows))
            for row in rows:
                if row.frames < stop:
                    lines.append(f"left out: {row.clip} has {row.frames} frames, and the window ends at {stop}.")
                    continue
                began = time.perf_counter()
                window = np.zeros((weights.frames, weights.basis.size, 3), np.float32)
                window[: weights.known] = view.window(row.clip, config.start, known)
                window[-1:] = view.window(row.clip, last, stop)
                made = weights.complete(window[None])[0]
                seconds += time.perf_counter() - began
                ends = reader.vertices(row.clip, config.start, known), reader.vertices(row.clip, last, stop)
                writer.add_dense(
                    replace(row, frames=weights.frames, seconds=weights.frames / row.fps),
                    chain([ends[0]], vertices_in_parts(weights.basis, made), [ends[1]]),
                )
                clips += 1
                progress.advance(1, row.clip)
            if not clips:
                raise InputError(f"No clip of {config.mesh} reaches frame {stop}, where the window ends.")
            completed = weights.frames - weights.known - 1
            draft.summary |= {"clips": clips, "known": weights.known, "completed": completed}
        rate = rows[0].fps
    times = clips * completed / rate / max(seconds, 1e-9)
    said = f"{clips} clips, {completed} frames completed after {weights.known} known ones, at {times:.1f} times "
    figures = {"clips": clips, "completed": completed, "seconds": seconds, "times_real_time": times}
    return StageReport(output=config.output, lines=[f"{said}real time.", *lines], figures=figures)
