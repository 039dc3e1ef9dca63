"""`pumps complete-mesh`: one window of each mesh sequence, completed between its known frames and its last one."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import chain

import numpy as np

from data_schemas.errors import InputError
from stages.complete_mesh.config import Config
from stages.shared.contract import StageReport
from stages.shared.inference.rewritten_meshes import rewritten_meshes
from stages.shared.inference.spectral import load_spectral, vertices_in_parts
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
    clips, seconds, played = 0, 0.0, 0.0
    known, last, stop = config.start + weights.known, config.start + weights.frames - 1, config.start + weights.frames
    completed = weights.frames - weights.known - 1
    opened = (config.mesh, config.output, weights, str(config.weights), config.where, "complete-mesh", config)
    with rewritten_meshes(*opened) as meshes:
        reader = meshes.reader
        progress.start("Completing meshes", total=len(meshes.rows))
        for row in meshes.rows:
            progress.advance(1, row.clip)
            if row.frames < stop:
                lines.append(f"left out: {row.clip} has {row.frames} frames, and the window ends at {stop}.")
                continue
            began = time.perf_counter()
            window = np.zeros((weights.frames, weights.basis.size, 3), np.float32)
            window[: weights.known] = meshes.view.window(row.clip, config.start, known)
            window[-1:] = meshes.view.window(row.clip, last, stop)
            made = weights.complete(window[None])[0]
            seconds += time.perf_counter() - began
            ends = reader.vertices(row.clip, config.start, known), reader.vertices(row.clip, last, stop)
            meshes.writer.add_dense(
                replace(row, frames=weights.frames, seconds=weights.frames / row.fps),
                chain([ends[0]], vertices_in_parts(weights.basis, made), [ends[1]]),
            )
            clips += 1
            played += completed / row.fps
        if not clips:
            raise InputError(f"No clip of {config.mesh} reaches frame {stop}, where the window ends.")
        meshes.draft.summary |= {"clips": clips, "known": weights.known, "completed": completed}
    times = played / max(seconds, 1e-9)
    said = f"{clips} clips, {completed} frames completed after {weights.known} known ones, at {times:.1f} times "
    figures = {"clips": clips, "completed": completed, "seconds": seconds, "times_real_time": times}
    return StageReport(output=config.output, lines=[f"{said}real time.", *lines], figures=figures)
